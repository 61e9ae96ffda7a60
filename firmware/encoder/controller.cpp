#include "controller.h"

#include <util/atomic.h>

#include "encoders.h"
#include "motors.h"
#include "reset_cause.h"
#include "serial_port.h"

namespace {

// How long the signs of a broken encoder are gathered: a quarter of a second.
constexpr uint16_t SIGNS_MASK = TICK_HZ / 4 - 1;

static_assert(TICK_HZ == 512, "64 ticks are 125 ms");

} // namespace

void Controller::begin(uint8_t flags) {
    axes_.begin();
    set_watchdog_ms(WATCHDOG_DEFAULT_MS);
    global_ = flags;
}

void Controller::tick() {
    const uint8_t left_out = ticker::take_left_out();
    if (left_out) global_ |= GLOBAL_LATE;
    const uint8_t ticks = left_out == 255 ? 255 : static_cast<uint8_t>(left_out + 1);
    axes_.measure();
    switches_.sample(switches_open_);
    pins_.sample(ticks);
    obey_requests();
    watch_counts();
    if (powered()) control(ticks);
    else doubt_homes();
    pass_time(ticks);
}

void Controller::pass_time(uint8_t ticks) {
    while (ticks--) {
        ++ticks_;
        if ((ticks_ & 63) == 0) milliseconds_ += 125;
        if ((ticks_ & SIGNS_MASK) == 0) encoders::forget_signs();
    }
}

void Controller::control(uint8_t ticks) {
    watch_host(ticks);
    if (mode_ == Mode::HOMING) run_homing();
    if (!powered()) return;
    axes_.advance();
    axes_.drive();
    guard();
    if (mode_ == Mode::HELD) finish_hold(ticks);
}

void Controller::obey_requests() {
    const serial_port::Requests requests = serial_port::take_requests();
    if (requests.stop) {
        switch_off();
        global_ |= GLOBAL_STOPPED;
        tell(EventKind::STOPPED);
        return;
    }
    if (requests.hold && powered()) hold();
    // Nothing moves by a release; and the watchdog's braking is not undone.
    if (requests.release && mode_ == Mode::HELD && !off_ticks_) mode_ = Mode::ON;
}

void Controller::hold() {
    if (mode_ == Mode::HELD) return;
    homing_.abort();
    mode_ = Mode::HELD;
    held_told_ = false;
    for (uint8_t axis = 0; axis < AXES; ++axis) axes_.profile(axis).run_at(0);
}

void Controller::finish_hold(uint8_t ticks) {
    if (off_ticks_) {
        off_ticks_ = off_ticks_ > ticks ? static_cast<uint16_t>(off_ticks_ - ticks) : 0;
        if (!off_ticks_) switch_off();
    } else if (!held_told_ && axes_.at_rest()) {
        held_told_ = true;
        tell(EventKind::HELD);
    }
}

void Controller::watch_host(uint8_t ticks) {
    if (off_ticks_ || !watchdog_.step(ticks)) return;
    hold();
    off_ticks_ = watchdog_.brake_ticks();
    // In less time than the motors stay on; the joints follow their setpoints a little late.
    for (uint8_t axis = 0; axis < AXES; ++axis) axes_.profile(axis).brake(off_ticks_ / 2);
    global_ |= GLOBAL_WATCHDOG;
    tell(EventKind::WATCHDOG);
}

void Controller::run_homing() {
    const Homing::Outcome outcome = homing_.step(axes_, switches_, homing_verdict());
    const uint8_t axis = homing_.axis();
    switch (outcome) {
    case Homing::GOING_ON: break;
    case Homing::AXIS_HOMED:
        homed_ |= static_cast<uint8_t>(1 << axis);
        tell(EventKind::HOMED, axis);
        break;
    case Homing::DONE:
        mode_ = Mode::ON;
        tell(EventKind::HOME_DONE);
        break;
    case Homing::FAILED:
        tell(EventKind::HOME_FAILED, axis, static_cast<uint8_t>(homing_.failure()));
        trip(axis, FAULT_HOMING);
        break;
    case Homing::RUNAWAY: trip(axis, FAULT_FOLLOW); break;
    case Homing::NO_COUNTS: trip(axis, FAULT_ENCODER); break;
    }
}

DriveWatch::Verdict Controller::homing_verdict() const {
    const uint8_t axis = homing_.axis(), other = axes_.partner(axis);
    const DriveWatch::Verdict own = axes_.verdict(axis);
    return own != DriveWatch::FINE || other == NO_AXIS ? own : axes_.verdict(other);
}

bool Controller::is_homing(uint8_t axis) const {
    return homing_.active() && (axis == homing_.axis() || axes_.partner(axis) == homing_.axis());
}

void Controller::guard() {
    for (uint8_t axis = 0; axis < AXES && powered(); ++axis) {
        if (!axes_.driven(axis)) continue;
        const bool homing_it = is_homing(axis);
        guard_motor(axis, homing_it);
        if (powered()) guard_joint(axis, homing_it);
    }
}

// An arm that sinks or is pushed while its motors are off, and whose counts go wrong by that.
void Controller::doubt_homes() {
    for (uint8_t axis = 0; axis < AXES; ++axis) {
        if (encoders::broken(axis)) unhome_motor(axis);
    }
}

// A few lost edges are told; with more of them nobody knows where the joint is, on or off.
void Controller::watch_counts() {
    if (!axes_.take_losses()) return;
    for (uint8_t axis = 0; axis < AXES; ++axis) {
        if (homed(axis) && axes_.lost_edges(axis) > LOST_EDGES_MAX) trip(axis, FAULT_LOST);
    }
}

void Controller::guard_motor(uint8_t axis, bool homing_it) {
    if (encoders::broken(axis)) {
        trip(axis, FAULT_ENCODER);
        return;
    }
    const DriveWatch::Verdict verdict = axes_.verdict(axis);
    // Homing runs against stops; it takes the verdict itself.
    if (verdict == DriveWatch::FINE || homing_it) return;
    trip(axis, verdict == DriveWatch::STALLED ? FAULT_STALL : FAULT_ENCODER);
}

void Controller::guard_joint(uint8_t axis, bool homing_it) {
    const Settings &settings = axes_.settings(axis);
    const int32_t error = axes_.following_error(axis);
    const int32_t allowed = settings.following;
    if (homed(axis) && !homing_it) {
        const int32_t setpoint = axes_.position(axis) + error;
        const int32_t beyond = error > 0 ? settings.low - axes_.position(axis)
                                         : axes_.position(axis) - settings.high;
        if (setpoint >= settings.low && setpoint <= settings.high && beyond > allowed / 2) {
            trip(axis, FAULT_LIMIT);
            return;
        }
    }
    if (error > allowed || error < -allowed) trip(axis, FAULT_FOLLOW);
}

// Where the joint is, is no longer known; nor where a joint is that its motor turns with another.
void Controller::unhome_motor(uint8_t axis) {
    unhome(axis);
    if (axes_.partner(axis) != NO_AXIS) unhome(axes_.partner(axis));
}

void Controller::trip(uint8_t axis, Fault fault) {
    motors::cut();
    homing_.abort();
    off_ticks_ = 0;
    mode_ = Mode::TRIPPED;
    faults_[axis] |= fault;
    if (fault == FAULT_ENCODER || fault == FAULT_LOST) unhome_motor(axis);
    tell(EventKind::TRIP, axis, fault);
}

bool Controller::switch_on() {
    axes_.hold_here();
    encoders::forget_signs();
    watchdog_.feed();
    // A stop comes either before this and is seen, or after it and cuts what is on.
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (serial_port::stopped_since()) return false;
        motors::enable();
    }
    global_ &= static_cast<uint8_t>(~(GLOBAL_WATCHDOG | GLOBAL_STOPPED | GLOBAL_LATE));
    mode_ = Mode::ON;
    return true;
}

void Controller::switch_off() {
    motors::cut();
    homing_.abort();
    off_ticks_ = 0;
    if (mode_ != Mode::TRIPPED) mode_ = Mode::OFF;
}

bool Controller::home(uint8_t wanted) {
    if (mode_ == Mode::OFF && !switch_on()) return false;
    homed_ &= static_cast<uint8_t>(~wanted);
    homing_.begin(axes_, wanted);
    mode_ = Mode::HOMING;
    return true;
}

void Controller::clear_faults() {
    for (uint8_t &faults : faults_) faults = 0;
    global_ = 0;
    reset_cause::forget();
    if (mode_ == Mode::TRIPPED) mode_ = Mode::OFF;
}

void Controller::configure(uint8_t axis, const Settings &settings) {
    const Settings &before = axes_.settings(axis);
    if (homes_differ(settings, before)) unhome(axis);
    if (motors_differ(settings, before)) unhome_motor(axis);
    const uint8_t bit = static_cast<uint8_t>(1 << axis);
    switches_open_ = static_cast<uint8_t>(settings.switch_opens ? switches_open_ | bit : switches_open_ & ~bit);
    axes_.configure(axis, settings);
}

void Controller::pair(uint8_t sum, uint8_t difference) {
    if (sum == axes_.pair_sum() && difference == axes_.pair_difference()) return;
    const uint8_t concerned[] = {axes_.pair_sum(), axes_.pair_difference(), sum, difference};
    for (const uint8_t axis : concerned) {
        if (axis != NO_AXIS) unhome(axis);
    }
    axes_.pair(sum, difference);
}
