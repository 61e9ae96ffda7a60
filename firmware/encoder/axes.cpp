#include "axes.h"

#include "encoders.h"
#include "motors.h"

namespace {

constexpr uint8_t STANDING_TICKS = ms_to_ticks(20);
constexpr uint8_t VELOCITY_SHIFT = 8; // filtered velocities are in 1/256 count/s
constexpr uint8_t FILTER_SHIFT = 2; // it settles in 8 ms: one count more is 128 counts/s, not 512
constexpr int32_t FAST = 512L << VELOCITY_SHIFT;
constexpr uint8_t FAST_TICKS = ms_to_ticks(30);

void add(uint8_t &sum, uint8_t more) { sum = more > 255 - sum ? 255 : static_cast<uint8_t>(sum + more); }

int16_t clamped(int32_t velocity) {
    return static_cast<int16_t>(velocity > 0x7FFF ? 0x7FFF : velocity < -0x7FFF ? -0x7FFF : velocity);
}

} // namespace

void Axes::begin() {
    for (uint8_t axis = 0; axis < AXES; ++axis) configure(axis, default_settings(axis));
    pair(3, 4);
}

void Axes::configure(uint8_t axis, const Settings &settings) {
    settings_[axis] = settings;
    joints_[axis].profile.limit(settings.low, settings.high, settings.velocity, settings.acceleration);
    motors_[axis].pid.set(settings);
    motors_[axis].watch.set(ms_to_ticks(settings.stall_ms), settings.drive_limit);
}

void Axes::pair(uint8_t sum, uint8_t difference) {
    sum_ = sum;
    difference_ = difference;
}

uint8_t Axes::partner(uint8_t axis) const {
    return axis == sum_ ? difference_ : axis == difference_ ? sum_ : NO_AXIS;
}

void Axes::recount(uint8_t axis, int32_t from, int32_t to) {
    joints_[axis].offset += to - from;
    joints_[axis].fine_offset = shifted_up<TICK_SHIFT>(joints_[axis].offset);
    joints_[axis].position += to - from;
    joints_[axis].lost_edges = 0;
    joints_[axis].profile.shift(to - from);
}

void Axes::measure() {
    for (uint8_t axis = 0; axis < AXES; ++axis) {
        Motor &motor = motors_[axis];
        const encoders::Seen seen = encoders::take(axis);
        const int16_t counts = settings_[axis].encoder_inverted ? static_cast<int16_t>(-seen.counts) : seen.counts;
        if (counts) {
            motor.count += counts;
            motor.still_ticks = 0;
        } else if (motor.still_ticks < STANDING_TICKS) {
            ++motor.still_ticks;
        }
        const int32_t now = shifted_up<TICK_SHIFT + VELOCITY_SHIFT>(counts);
        motor.velocity += (now - motor.velocity) >> FILTER_SHIFT;
        if (seen.lost) note_lost(axis, seen.lost);
        const uint8_t lost = lost_pulses(motor, seen.turned);
        if (lost) note_lost(axis, lost);
    }
    locate();
}

// A motor of a pair turns both joints.
void Axes::note_lost(uint8_t axis, uint8_t edges) {
    losses_ = true;
    add(joints_[axis].lost_edges, edges);
    if (partner(axis) != NO_AXIS) add(joints_[partner(axis)].lost_edges, edges);
}

// No motor turns round and back at speed. Where its counts do and the speed goes on, a pulse of one channel
// was not seen: its two edges were lost. One that hits something turns round as well, and is slow then.
uint8_t Axes::lost_pulses(Motor &motor, uint8_t turned) {
    const bool backward = motor.velocity < 0;
    const bool fast = motor.velocity >= FAST || motor.velocity <= -FAST;
    if (!fast || backward != motor.backward) {
        motor.turned = 0;
        motor.backward = backward;
        return 0;
    }
    if (turned) {
        add(motor.turned, turned);
        motor.fast_ticks = 0;
    }
    if (!motor.turned || ++motor.fast_ticks < FAST_TICKS) return 0;
    const uint8_t lost = motor.turned;
    motor.turned = 0;
    return lost;
}

void Axes::locate() {
    for (uint8_t axis = 0; axis < AXES; ++axis) {
        joints_[axis].position = motors_[axis].count + joints_[axis].offset;
    }
    if (sum_ == NO_AXIS) return;
    const int32_t a = motors_[sum_].count, b = motors_[difference_].count;
    joints_[sum_].position = a + b + joints_[sum_].offset;
    joints_[difference_].position = a - b + joints_[difference_].offset;
}

bool Axes::driven(uint8_t axis) const {
    const uint8_t other = partner(axis);
    return settings_[axis].used() || (other != NO_AXIS && settings_[other].used());
}

void Axes::advance() {
    for (Joint &joint : joints_) joint.profile.step();
}

// Each motor of a pair may stand one count off, and their joints then two: then the motors have to be exact.
bool Axes::pair_is_off() const {
    if (sum_ == NO_AXIS) return false;
    const int32_t p = following_error(sum_), r = following_error(difference_);
    return p > 1 || p < -1 || r > 1 || r < -1;
}

void Axes::drive() {
    int32_t targets[AXES];
    int16_t velocities[AXES];
    for (uint8_t axis = 0; axis < AXES; ++axis) {
        targets[axis] = joints_[axis].profile.position() - joints_[axis].fine_offset;
        velocities[axis] = joints_[axis].profile.velocity();
    }
    if (sum_ != NO_AXIS) {
        const int32_t p = targets[sum_] / 2, r = targets[difference_] / 2;
        targets[sum_] = p + r;
        targets[difference_] = p - r;
        const int16_t vp = velocities[sum_] / 2, vr = velocities[difference_] / 2;
        velocities[sum_] = vp + vr;
        velocities[difference_] = vp - vr;
    }
    const bool exact_pair = pair_is_off();
    for (uint8_t axis = 0; axis < AXES; ++axis) {
        if (!driven(axis)) continue;
        Motor &motor = motors_[axis];
        const int16_t drive = motor.pid.step({targets[axis], velocities[axis], motor.count,
                                              clamped(shifted_down<VELOCITY_SHIFT>(motor.velocity)),
                                              motor.still_ticks >= STANDING_TICKS,
                                              exact_pair && partner(axis) != NO_AXIS});
        motor.verdict = motor.watch.step(motor.count, drive);
        motors::drive(axis, settings_[axis].motor_inverted ? static_cast<int16_t>(-drive) : drive);
    }
}

void Axes::hold_here() {
    for (uint8_t axis = 0; axis < AXES; ++axis) {
        joints_[axis].profile.stand_at(joints_[axis].position);
        motors_[axis].pid.reset();
        motors_[axis].watch.reset(motors_[axis].count);
        motors_[axis].verdict = DriveWatch::FINE;
    }
}

void Axes::relax(uint8_t axis) {
    joints_[axis].profile.stand_at(joints_[axis].position);
    const uint8_t turned[2] = {axis, partner(axis)};
    for (const uint8_t i : turned) {
        if (i == NO_AXIS) continue;
        motors_[i].pid.reset();
        motors_[i].watch.restart();
        motors_[i].verdict = DriveWatch::FINE;
    }
}

bool Axes::at_rest() const {
    for (const Joint &joint : joints_) {
        if (!joint.profile.at_rest()) return false;
    }
    return true;
}
