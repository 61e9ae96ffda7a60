/* The arm at an encoder board: motors, gears, encoders, home switches, friction and loads, stepped with
 * the simulated CPU. It reads the bridges out of the timers' registers and moves the input pins.
 *
 * Everything is in encoder counts and seconds. A motor's speed follows its drive with one time constant;
 * dry friction holds it until the drive breaks it away. plant.py has the same structures.
 */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#include <avr_ioport.h>
#include <sim_avr.h>
#include <sim_cycle_timers.h>
#include <sim_interrupts.h>
#include <sim_io.h>

enum { AXES = 6, STEP_CYCLES = 800 };

/* Data addresses and number of the ATmega2560's third pin-change interrupt, that of port K. */
enum { PORT_K = 'K' - 'A', PCIFR = 0x3B, PCICR = 0x68, PCMSK2 = 0x6D, PCINT2_VECTOR = 11 };

typedef struct {
    /* wiring: data addresses of the registers, pins as 8 * port + bit */
    uint16_t duty, top, control, direction;
    uint8_t control_mask, direction_mask;
    uint8_t pin_a, pin_b, pin_switch;
    int8_t motor_sign; /* -1: the motor's wires are swapped */
    /* the motor with its gear, at the encoder */
    double full_speed;       /* of a motor without friction at full drive [counts/s] */
    double time_constant;    /* [s] */
    double static_friction;  /* [share of full drive] */
    double kinetic_friction; /* [share of full drive] */
    double load;             /* gravity, at most [share of full drive], pulling down the counts */
    double load_period;      /* [counts] a turn of the joint */
    /* the joint that this axis names (for a pair: sum or difference of the two motors) */
    double low_stop, high_stop;
    double switch_low, switch_high; /* pressed between them; equal: no switch */
    /* what is wrong */
    uint8_t blocked, torn_a, torn_b, switch_stuck; /* switch_stuck: 1 open, 2 pressed */
    uint32_t lost_edges;  /* so many of the next edges are not shown: the one after comes with it */
    uint32_t lost_pulses; /* so many of the next pulses of channel A are not shown */
    /* where it is */
    double position, speed; /* of the motor */
    int32_t shown;          /* what the encoder shows */
    uint8_t hidden, level_a, losing; /* an edge is lost; channel A as shown; within a pulse that is lost */
    double way;             /* all that the motor has turned so far, without sign */
    double drive;           /* at the last step, -1 ... 1 */
    /* how the bridge is treated */
    uint8_t backward;    /* the direction pin at the last step */
    uint32_t idle_steps; /* that the duty has been 0 for */
    uint32_t hot_turns;  /* changes of direction before the timer had let a duty of 0 out */
} axis_t;

typedef struct plant plant_t;

/* What the moment of an edge carries: simavr hands it back untouched. */
typedef struct {
    plant_t *plant;
    axis_t *axis;
} edge_tag_t;

struct plant {
    avr_io_t io; /* first: simavr hands this back on a reset */
    axis_t *axes;
    edge_tag_t tags[AXES];
    int8_t pair_sum, pair_difference; /* -1: none */
    uint16_t enable;                  /* register of the enable pin */
    uint8_t enable_mask;
    uint8_t fresh; /* the CPU has been reset: every pin must be shown again */
    uint8_t mask[12], level[12];
    avr_int_vector_t port_k; /* simavr 1.6 knows the pin-change interrupt of port B alone */
};

static void show(plant_t *plant, int pin, int level)
{
    int port = pin / 8, bit = 1 << (pin % 8);
    uint8_t levels = (uint8_t)(level ? plant->level[port] | bit : plant->level[port] & ~bit);
    if (!plant->fresh && levels == plant->level[port]) {
        return;
    }
    plant->level[port] = levels;
    plant->mask[port] |= (uint8_t)bit;
    avr_ioport_external_t held = {
        .name = (unsigned)('A' + port), .mask = plant->mask[port], .value = plant->level[port]};
    avr_ioctl(plant->io.avr, AVR_IOCTL_IOPORT_SET_EXTERNAL('A' + port), &held);
    avr_irq_t *irq = avr_io_getirq(plant->io.avr, AVR_IOCTL_IOPORT_GETIRQ('A' + port), pin % 8);
    if (plant->fresh) {
        avr_raise_irq(irq, !level); /* a reset clears the PIN register, but a level that is not new is not told */
    }
    avr_raise_irq(irq, (uint32_t)level);
    if (port == PORT_K && plant->io.avr->data[PCMSK2] & bit) {
        avr_raise_interrupt(plant->io.avr, &plant->port_k);
    }
}

static unsigned word(const avr_t *avr, uint16_t address)
{
    return avr->data[address] | (unsigned)avr->data[address + 1] << 8;
}

static double drive_of(const plant_t *plant, const axis_t *axis)
{
    const avr_t *avr = plant->io.avr;
    if (!(avr->data[axis->control] & axis->control_mask) || !word(avr, axis->top)) {
        return 0.0;
    }
    double share = fmin(1.0, (double)word(avr, axis->duty) / word(avr, axis->top));
    return axis->motor_sign * (avr->data[axis->direction] & axis->direction_mask ? -share : share);
}

/* A timer in phase-correct PWM takes a new duty at the end of its period, 64 us: a step and a part. */
static void watch_bridge(const plant_t *plant, axis_t *axis)
{
    const avr_t *avr = plant->io.avr;
    uint8_t backward = avr->data[axis->direction] & axis->direction_mask ? 1 : 0;
    if (backward != axis->backward && axis->idle_steps < 2) {
        axis->hot_turns++;
    }
    axis->backward = backward;
    axis->idle_steps = word(avr, axis->duty) ? 0 : axis->idle_steps + 1;
}

static void turn(const plant_t *plant, axis_t *axis, double dt)
{
    watch_bridge(plant, axis);
    int powered = plant->io.avr->data[plant->enable] & plant->enable_mask ? 1 : 0;
    axis->drive = powered ? drive_of(plant, axis) : 0.0;
    double load = axis->load ? axis->load * cos(6.283185307179586 * axis->position / axis->load_period) : 0.0;
    double pull = axis->drive - load;
    if (axis->blocked || (axis->speed == 0.0 && fabs(pull) <= axis->static_friction)) {
        axis->speed = 0.0;
        return;
    }
    double against = axis->speed != 0.0 ? copysign(axis->kinetic_friction, axis->speed)
                                        : copysign(axis->kinetic_friction, pull);
    /* A motor that is switched off runs on without its own brake, the voltage it generates. */
    double damping = powered ? axis->speed : 0.0;
    double before = axis->speed;
    axis->speed += ((pull - against) * axis->full_speed - damping) * dt / axis->time_constant;
    if (before * axis->speed < 0.0) {
        axis->speed = 0.0; /* friction stops; it does not turn round */
    }
    axis->position += axis->speed * dt;
    axis->way += fabs(axis->speed) * dt;
}

/* Hard stops of a joint turned by one motor, or by the sum (sign 1) or difference (-1) of two. */
static void stop(axis_t *joint, axis_t *a, axis_t *b, int sign)
{
    double position = a->position + (b ? sign * b->position : 0.0);
    double speed = a->speed + (b ? sign * b->speed : 0.0);
    double over = position > joint->high_stop ? position - joint->high_stop
                  : position < joint->low_stop ? position - joint->low_stop : 0.0;
    if (over == 0.0) {
        return;
    }
    double share = b ? 0.5 : 1.0;
    a->position -= share * over;
    if (over * speed > 0.0) {
        a->speed -= share * speed;
    }
    if (b) {
        b->position -= sign * share * over;
        if (over * speed > 0.0) {
            b->speed -= sign * share * speed;
        }
    }
}

static void show_encoder(plant_t *plant, axis_t *axis)
{
    static const uint8_t levels[4] = {0, 1, 3, 2}; /* bit 0: A, bit 1: B; A leads upwards */
    uint8_t now = levels[axis->shown & 3];
    if (!axis->lost_pulses) {
        axis->level_a = now & 1;
    } else if ((now & 1) != axis->level_a) {
        axis->losing = 1;
    } else if (axis->losing) {
        axis->losing = 0;
        axis->lost_pulses--;
    }
    show(plant, axis->pin_a, axis->torn_a || axis->level_a);
    show(plant, axis->pin_b, axis->torn_b || now & 2);
}

static avr_cycle_count_t show_edge(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)avr, (void)when;
    edge_tag_t *tag = param;
    show_encoder(tag->plant, tag->axis);
    return 0;
}

/* One edge a step, at the part of it at which the motor passed: those of several axes come one by one. */
static void turn_encoder(plant_t *plant, axis_t *axis, edge_tag_t *tag, double before)
{
    int32_t count = (int32_t)floor(axis->position);
    if (count == axis->shown) {
        if (!axis->hidden) {
            show_encoder(plant, axis); /* a wire may just have been torn */
        }
        return;
    }
    int up = count > axis->shown;
    double passed = axis->shown + (up ? 1.0 : 0.0), way = axis->position - before;
    double part = way != 0.0 ? fmin(fmax((passed - before) / way, 0.0), 1.0) : 0.0;
    axis->shown += up ? 1 : -1;
    axis->hidden = axis->lost_edges != 0;
    if (axis->hidden) {
        axis->lost_edges--;
    } else if (plant->fresh) {
        show_encoder(plant, axis);
    } else {
        avr_cycle_timer_register(plant->io.avr, 1 + (avr_cycle_count_t)(part * (STEP_CYCLES - 10)), show_edge, tag);
    }
}

static void show_switch(plant_t *plant, axis_t *axis, double joint)
{
    int pressed = joint >= axis->switch_low && joint < axis->switch_high;
    if (axis->switch_stuck) {
        pressed = axis->switch_stuck == 2;
    }
    show(plant, axis->pin_switch, !pressed);
}

static avr_cycle_count_t step(avr_t *avr, avr_cycle_count_t when, void *param)
{
    plant_t *plant = param;
    axis_t *axes = plant->axes;
    int s = plant->pair_sum, d = plant->pair_difference;
    double before[AXES];
    for (int i = 0; i < AXES; i++) {
        before[i] = axes[i].position;
        turn(plant, &axes[i], (double)STEP_CYCLES / avr->frequency);
    }
    for (int i = 0; i < AXES; i++) {
        int paired = s >= 0 && (i == s || i == d);
        axis_t *a = paired ? &axes[s] : &axes[i], *b = paired ? &axes[d] : NULL;
        int sign = i == d ? -1 : 1;
        stop(&axes[i], a, b, sign);
        show_switch(plant, &axes[i], a->position + (b ? sign * b->position : 0.0));
    }
    for (int i = 0; i < AXES; i++) {
        turn_encoder(plant, &axes[i], &plant->tags[i], before[i]);
    }
    plant->fresh = 0;
    return when + STEP_CYCLES;
}

/* simavr drops all its timers on a reset, whoever causes it. */
static void on_reset(avr_io_t *io)
{
    plant_t *plant = (plant_t *)io;
    plant->fresh = 1;
    avr_cycle_timer_register(io->avr, STEP_CYCLES, step, plant);
}

/* NULL: no memory. Lives longer than the simulator; axes are the caller's. */
plant_t *plant_new(avr_t *avr, axis_t *axes, int pair_sum, int pair_difference, int enable, int enable_mask)
{
    plant_t *plant = calloc(1, sizeof *plant);
    if (plant) {
        plant->io = (avr_io_t){.kind = "plant", .reset = on_reset};
        plant->axes = axes;
        for (int i = 0; i < AXES; i++) {
            plant->tags[i] = (edge_tag_t){.plant = plant, .axis = &axes[i]};
        }
        plant->pair_sum = (int8_t)pair_sum;
        plant->pair_difference = (int8_t)pair_difference;
        plant->enable = (uint16_t)enable;
        plant->enable_mask = (uint8_t)enable_mask;
        plant->port_k = (avr_int_vector_t){.vector = PCINT2_VECTOR,
                                           .enable = {.reg = PCICR, .bit = 2, .mask = 1},
                                           .raised = {.reg = PCIFR, .bit = 2, .mask = 1}};
        avr_register_io(avr, &plant->io);
        avr_register_vector(avr, &plant->port_k);
        on_reset(&plant->io);
    }
    return plant;
}

void plant_free(plant_t *plant) { free(plant); }
