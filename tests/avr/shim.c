/* A simulated AVR that is stepped from outside: bytes and pin levels in, bytes and pin edges out.
 *
 * Wraps libsimavr for ctypes (see avr.py). No threads and no clock of its own: the same calls give
 * the same edges, to the cycle. Pins are numbered 8 * (port - 'A') + bit.
 *
 * gcc -O2 -shared -fPIC -o libavr.so shim.c $(pkg-config --cflags --libs simavr)
 */
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <avr_extint.h>
#include <avr_ioport.h>
#include <avr_timer.h>
#include <avr_twi.h>
#include <avr_uart.h>
#include <sim_avr.h>
#include <sim_core.h>
#include <sim_cycle_timers.h>
#include <sim_hex.h>

enum {
    PORTS = 12, /* A ... L */
    PINS = PORTS * 8,
    QUEUE = 1 << 17, /* entries of every buffer; a power of two */
    SLICE = 4000,    /* cycles between two looks at the cycle timers, at most (see sim_run) */
};

/* What sim_run returns. */
enum { SIM_OK = 0, SIM_CRASHED = 1, SIM_DONE = 2, SIM_OVERFLOW = 3 };

typedef struct {
    uint64_t cycle;
    uint8_t pin;
    uint8_t level;
    uint8_t unused[6];
} edge_t;

typedef struct sim sim_t;

/* What is on the I2C bus: gets what the CPU puts there, and answers with a message of simavr's; 0: nobody. */
typedef uint32_t (*bus_t)(uint8_t message, uint8_t address, uint8_t data);

/* What a pin's notification carries: simavr hands it back untouched. */
typedef struct {
    sim_t *sim;
    uint8_t pin;
} pin_tag_t;

struct sim {
    avr_t *avr;
    avr_io_t resets; /* told of every reset */
    avr_irq_t *uart_input, *twi_input;
    bus_t bus;
    int uart_full; /* the UART's receive queue takes no more */
    int overflow;  /* a buffer below was full: something was lost */
    int driving;   /* a level is being set from outside: not an edge of the firmware's */

    uint16_t received[QUEUE]; /* with UART_INPUT_FE: badly framed. From the host, waiting for room in the UART: a ring */
    uint32_t received_head, received_tail;
    unsigned char sent[QUEUE]; /* by the firmware, not yet fetched */
    uint32_t sent_count;
    edge_t edges[QUEUE]; /* of the watched pins, not yet fetched */
    uint32_t edge_count;
    edge_t changes[QUEUE]; /* levels to be set from outside, in the order of their cycles */
    uint32_t change_head, change_count;

    uint8_t level[PINS];
    uint8_t watched[PINS];
    uint8_t outside_mask[PORTS], outside_level[PORTS]; /* what sim_set_pin holds */
    pin_tag_t tags[PINS];
    char log[4096];
};

static void feed_uart(sim_t *sim)
{
    while (!sim->uart_full && sim->received_head != sim->received_tail) {
        avr_raise_irq(sim->uart_input, sim->received[sim->received_head++ & (QUEUE - 1)]);
    }
}

static void on_uart_room(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)value;
    sim_t *sim = param;
    sim->uart_full = 0;
    feed_uart(sim);
}

static void on_uart_full(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)value;
    ((sim_t *)param)->uart_full = 1;
}

static void on_uart_sent(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    sim_t *sim = param;
    if (sim->sent_count == QUEUE) {
        sim->overflow = 1;
        return;
    }
    sim->sent[sim->sent_count++] = (unsigned char)value;
}

static void on_pin(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    pin_tag_t *tag = param;
    sim_t *sim = tag->sim;
    uint8_t level = value & 1; /* the other bits say who drives the pin */
    if (sim->level[tag->pin] == level) {
        return;
    }
    sim->level[tag->pin] = level;
    if (!sim->watched[tag->pin] || sim->driving) {
        return;
    }
    if (sim->edge_count == QUEUE) {
        sim->overflow = 1;
        return;
    }
    sim->edges[sim->edge_count++] = (edge_t){.cycle = sim->avr->cycle, .pin = tag->pin, .level = level};
}

/* simavr says why a CPU crashed in its log only; what it says is kept with the simulator. */
static void keep_log(avr_t *avr, const int level, const char *format, va_list arguments)
{
    if (!avr || level > LOG_ERROR || !avr->custom.data) {
        return;
    }
    sim_t *sim = avr->custom.data;
    size_t used = strlen(sim->log);
    vsnprintf(sim->log + used, sizeof sim->log - used, format, arguments);
}

static int load(avr_t *avr, const char *hex)
{
    ihex_chunk_p chunks = NULL;
    int count = read_ihex_chunks(hex, &chunks);
    for (int i = 0; i < count; i++) {
        if (chunks[i].baseaddr + chunks[i].size > avr->flashend + 1) {
            return -1;
        }
        memcpy(avr->flash + chunks[i].baseaddr, chunks[i].data, chunks[i].size);
    }
    /* Nothing in a hex file says where the code ends; a jump past the flash is still a crash. */
    avr->codeend = avr->flashend;
    return count > 0 ? 0 : -1;
}

static void never_sleep(avr_t *avr, avr_cycle_count_t cycles)
{
    (void)avr, (void)cycles; /* simavr would sleep in real time while the CPU does */
}

static void set_up_uart(sim_t *sim)
{
    avr_t *avr = sim->avr;
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    /* Else the firmware's bytes go to our standard output, and polling the UART sleeps in real time. */
    flags &= ~(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    sim->uart_input = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_uart_sent, sim);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), on_uart_room, sim);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), on_uart_full, sim);
}

/* simavr 1.6 does not know the Mega's phase-correct modes 1 ... 3, and mode 1 is what Arduino puts every
 * timer in: it then overflows at each of its ticks, which changes nothing for the firmware and takes half
 * of our time. The modes get the period they have, to 2 ticks (up and down again). */
static void set_up_timers(avr_t *avr)
{
    for (avr_io_t *io = avr->io_port; io; io = io->next) {
        if (strcmp(io->kind, "timer")) {
            continue;
        }
        avr_timer_t *timer = (avr_timer_t *)io; /* its first member */
        unsigned modes = timer->r_tcnth ? 3 : 1; /* of 8, 9 and 10 bits */
        for (unsigned mode = 1; mode <= modes; mode++) {
            if (timer->wgm_op[mode].kind == avr_timer_wgm_none) {
                timer->wgm_op[mode] = (avr_timer_wgm_t){.kind = avr_timer_wgm_fc_pwm, .size = 8 + mode};
            }
        }
    }
}

/* simavr 1.6 else looks at a low level-triggered interrupt in every cycle: 0.3 times real time. */
static avr_cycle_count_t calm_interrupts(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)when, (void)param;
    for (int i = 0; i < EXTINT_COUNT; i++) {
        if (avr_extint_is_strict_lvl_trig(avr, i) > 0) {
            avr_extint_set_strict_lvl_trig(avr, i, 0);
        }
    }
    return 0;
}

/* A reset, whoever causes it, brings that back; a cycle later the interrupts have had their own reset. */
static void on_reset(avr_io_t *io) { avr_cycle_timer_register(io->avr, 1, calm_interrupts, NULL); }

static avr_irq_t *pin_irq(sim_t *sim, int pin)
{
    return avr_io_getirq(sim->avr, AVR_IOCTL_IOPORT_GETIRQ('A' + pin / 8), pin % 8);
}

/* NULL: no such MCU, or the hex file cannot be read or does not fit. */
sim_t *sim_new(const char *mcu, uint32_t frequency, const char *hex)
{
    avr_global_logger_set(keep_log);
    sim_t *sim = calloc(1, sizeof *sim);
    avr_t *avr = sim ? avr_make_mcu_by_name(mcu) : NULL;
    if (!avr) {
        free(sim);
        return NULL;
    }
    sim->avr = avr;
    avr->custom.data = sim;
    avr_init(avr);
    avr->frequency = frequency;
    avr->log = LOG_ERROR;
    avr->sleep = never_sleep;
    if (load(avr, hex)) {
        avr_terminate(avr);
        free(sim);
        return NULL;
    }
    sim->resets = (avr_io_t){.kind = "resets", .reset = on_reset};
    avr_register_io(avr, &sim->resets);
    calm_interrupts(avr, 0, NULL);
    set_up_uart(sim);
    set_up_timers(avr);
    for (int pin = 0; pin < PINS; pin++) {
        avr_irq_t *irq = pin_irq(sim, pin);
        sim->tags[pin] = (pin_tag_t){.sim = sim, .pin = (uint8_t)pin};
        if (irq) {
            avr_irq_register_notify(irq, on_pin, &sim->tags[pin]);
        }
    }
    return sim;
}

void sim_free(sim_t *sim)
{
    avr_terminate(sim->avr);
    free(sim);
}

static void drive_pin(sim_t *sim, int pin, int level)
{
    int port = pin / 8, bit = pin % 8;
    sim->outside_mask[port] |= (uint8_t)(1 << bit);
    sim->outside_level[port] = (uint8_t)((sim->outside_level[port] & ~(1 << bit)) | (level << bit));
    /* Kept by the port as well: it sets its inputs anew whenever the firmware writes DDR or PORT. */
    avr_ioport_external_t held = {
        .name = (unsigned)('A' + port), .mask = sim->outside_mask[port], .value = sim->outside_level[port]};
    avr_ioctl(sim->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL('A' + port), &held);
    sim->driving = 1;
    avr_raise_irq(pin_irq(sim, pin), (uint32_t)level);
    sim->driving = 0;
}

static avr_cycle_count_t wake(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)avr, (void)when, (void)param;
    return 0;
}

static int run_to(sim_t *sim, uint64_t until)
{
    avr_t *avr = sim->avr;
    if (avr->cycle < until) {
        avr_cycle_timer_register(avr, until - avr->cycle, wake, NULL); /* a CPU that sleeps sleeps to its next timer */
    }
    while (avr->cycle < until) {
        /* simavr runs instructions in a row up to this limit or its next timer, whichever is first.
         * Its own default of one instruction is 2 times slower. */
        uint64_t left = until - avr->cycle;
        avr->run_cycle_limit = left < SLICE ? left : SLICE;
        int state = avr_run(avr);
        if (state == cpu_Crashed) {
            return SIM_CRASHED;
        }
        if (state == cpu_Done) {
            return SIM_DONE;
        }
    }
    return sim->overflow ? SIM_OVERFLOW : SIM_OK;
}

/* Run up to a cycle, or a few past it (an instruction is not cut), setting the scheduled levels on the way. */
int sim_run(sim_t *sim, uint64_t until)
{
    while (sim->change_head < sim->change_count && sim->changes[sim->change_head].cycle <= until) {
        edge_t change = sim->changes[sim->change_head++];
        int result = run_to(sim, change.cycle);
        if (result != SIM_OK) {
            return result;
        }
        drive_pin(sim, change.pin, change.level);
    }
    if (sim->change_head == sim->change_count) {
        sim->change_head = sim->change_count = 0;
    }
    return run_to(sim, until);
}

/* Levels to be set while sim_run passes their cycles. Cycles must not fall, over all calls. */
int sim_schedule(sim_t *sim, const edge_t *changes, uint32_t count)
{
    if (count > QUEUE - sim->change_count) {
        return SIM_OVERFLOW;
    }
    memcpy(sim->changes + sim->change_count, changes, count * sizeof *changes);
    sim->change_count += count;
    return SIM_OK;
}

/* The CPU itself, for a plant that hangs on simavr's own timers and pins. */
avr_t *sim_avr(sim_t *sim) { return sim->avr; }

uint64_t sim_cycle(const sim_t *sim) { return sim->avr->cycle; }

const char *sim_log(const sim_t *sim) { return sim->log; }

/* Where the CPU stands: the byte address in flash. */
uint32_t sim_program_counter(const sim_t *sim) { return sim->avr->pc; }

/* damaged: every byte comes with a framing error. */
int sim_write(sim_t *sim, const unsigned char *data, uint32_t count, int damaged)
{
    if (count > QUEUE - (sim->received_tail - sim->received_head)) {
        return SIM_OVERFLOW;
    }
    for (uint32_t i = 0; i < count; i++) {
        sim->received[sim->received_tail++ & (QUEUE - 1)] = (uint16_t)(data[i] | (damaged ? UART_INPUT_FE : 0));
    }
    feed_uart(sim);
    return SIM_OK;
}

uint32_t sim_read(sim_t *sim, unsigned char *data, uint32_t room)
{
    uint32_t count = sim->sent_count < room ? sim->sent_count : room;
    memcpy(data, sim->sent, count);
    memmove(sim->sent, sim->sent + count, sim->sent_count - count);
    sim->sent_count -= count;
    return count;
}

uint32_t sim_edges(sim_t *sim, edge_t *edges, uint32_t room)
{
    uint32_t count = sim->edge_count < room ? sim->edge_count : room;
    memcpy(edges, sim->edges, count * sizeof *edges);
    memmove(sim->edges, sim->edges + count, (sim->edge_count - count) * sizeof *edges);
    sim->edge_count -= count;
    return count;
}

static void on_twi(avr_irq_t *irq, uint32_t value, void *param)
{
    sim_t *sim = param;
    avr_twi_msg_irq_t seen = {.u.v = value};
    uint32_t answer = sim->bus(seen.u.twi.msg, seen.u.twi.addr, seen.u.twi.data);
    (void)irq;
    if (answer) {
        uint8_t message = (uint8_t)(answer >> 8), data = (uint8_t)answer;
        avr_raise_irq(sim->twi_input, avr_twi_irq_msg(message, seen.u.twi.addr, data));
    }
}

void sim_bus(sim_t *sim, bus_t bus)
{
    sim->bus = bus;
    sim->twi_input = avr_io_getirq(sim->avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_INPUT);
    avr_irq_register_notify(avr_io_getirq(sim->avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_OUTPUT), on_twi, sim);
}

void sim_watch(sim_t *sim, int pin, int watched) { sim->watched[pin] = (uint8_t)watched; }

void sim_set_pin(sim_t *sim, int pin, int level) { drive_pin(sim, pin, level); }

int sim_pin(const sim_t *sim, int pin) { return sim->level[pin]; }

/* A register or a byte of RAM by its data address. Hardware PWM in a phase-correct mode never reaches
 * a pin in simavr 1.6: its duty must be read out of TCCRnA and OCRnx. */
int sim_data(const sim_t *sim, uint32_t address) { return address <= sim->avr->ramend ? sim->avr->data[address] : -1; }

void sim_set_data(sim_t *sim, uint32_t address, uint8_t value)
{
    if (address <= sim->avr->ramend) {
        sim->avr->data[address] = value;
    }
}

/* The reset button (an external reset: RAM stays, what is on its way through the UART is lost). */
void sim_reset(sim_t *sim)
{
    uint32_t frequency = sim->avr->frequency;
    avr_reset(sim->avr);
    sim->avr->frequency = frequency; /* simavr may lose it */
    sim->received_head = sim->received_tail = 0;
    sim->uart_full = 0;
}
