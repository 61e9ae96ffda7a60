// What the arm is doing: the mode, the trips, and the control tick that moves everything.
//
// tick() runs in the timer interrupt. Everything else is for the main loop and holds a TickLock.
#pragma once

#include <stdint.h>

#include "axes.h"
#include "events.h"
#include "homing.h"
#include "host_watchdog.h"
#include "pins.h"
#include "switches.h"
#include "ticker.h"

enum class Mode : char { OFF = 'O', ON = 'N', HOMING = 'H', HELD = 'B', TRIPPED = 'T' };

enum GlobalFlag : uint8_t {
    GLOBAL_WATCHDOG = 1,
    GLOBAL_OVERRUN = 2,
    GLOBAL_BROWNOUT = 4,
    GLOBAL_STOPPED = 8,
    GLOBAL_INTERRUPTED = 16,
    GLOBAL_LATE = 32,
};

class Controller {
public:
    // Flags of the resets that no host has cleared yet.
    void begin(uint8_t flags);

    // The timer interrupt.
    void tick();

    // The host was heard.
    void feed_watchdog() {
        watchdog_.feed();
        pins_.feed();
    }
    void set_watchdog_ms(uint16_t ms) {
        watchdog_.set_ms(ms);
        pins_.set_watchdog_ticks(ms_to_ticks(ms));
    }

    // Do now what single bytes have asked for; see ControlLock.
    void obey_requests();

    // The modes say what is allowed; the caller has asked. False: a stop came in just now, the motors stay off.
    bool switch_on();
    void switch_off();
    bool home(uint8_t wanted);
    void clear_faults();
    void go_to(uint8_t axis, int32_t count, uint16_t ticks) { axes_.profile(axis).go_to(count, ticks); }
    // A line was too long, or bytes were lost.
    void note_overrun() { global_ |= GLOBAL_OVERRUN; }
    void forget_overrun() { global_ &= static_cast<uint8_t>(~GLOBAL_OVERRUN); }

    void configure(uint8_t axis, const Settings &settings);
    void pair(uint8_t sum, uint8_t difference);

    const Axes &axes() const { return axes_; }
    Mode mode() const { return mode_; }
    bool powered() const { return mode_ == Mode::ON || mode_ == Mode::HOMING || mode_ == Mode::HELD; }
    // Braking for the watchdog; the motors go off then.
    bool switching_off() const { return off_ticks_ != 0; }
    uint8_t homed() const { return homed_; }
    bool homed(uint8_t axis) const { return homed_ >> axis & 1; }
    uint8_t switches() const { return switches_.pressed(); }
    uint8_t global() const { return global_; }
    uint8_t faults(uint8_t axis) const { return faults_[axis]; }
    uint32_t ticks() const { return ticks_; }
    uint32_t milliseconds() const { return milliseconds_ + (((ticks_ & 63) * 125) >> 6); }
    EventQueue &events() { return events_; }
    Pins &pins() { return pins_; }

private:
    void pass_time(uint8_t ticks);
    void control(uint8_t ticks);
    void watch_host(uint8_t ticks);
    void hold();
    void finish_hold(uint8_t ticks);
    void run_homing();
    void doubt_homes();
    void watch_counts();
    void guard();
    void guard_motor(uint8_t axis, bool homing_it);
    void guard_joint(uint8_t axis, bool homing_it);
    bool is_homing(uint8_t axis) const;
    DriveWatch::Verdict homing_verdict() const;
    void trip(uint8_t axis, Fault fault);
    void unhome_motor(uint8_t axis);
    void unhome(uint8_t axis) { homed_ &= static_cast<uint8_t>(~(1 << axis)); }
    void tell(EventKind kind, uint8_t axis = 0, uint8_t detail = 0) { events_.put({kind, axis, detail}); }

    Axes axes_;
    Switches switches_;
    Homing homing_;
    HostWatchdog watchdog_;
    Pins pins_;
    EventQueue events_;
    Mode mode_ = Mode::OFF;
    uint8_t homed_ = 0;
    uint8_t global_ = 0;
    uint8_t faults_[AXES] = {};
    uint8_t switches_open_ = 0; // bit i: the home switch of axis i opens when pressed
    bool held_told_ = false;
    uint16_t off_ticks_ = 0; // braking for the watchdog: ticks until the motors go off
    uint32_t ticks_ = 0;
    uint32_t milliseconds_ = 0; // at the last 64th tick: both begin at 0 again, but not at once
};

// The lock for whoever looks at the mode or changes it: a `!`, `~` or 0x18 that was received before is
// obeyed before, and not only at the next tick.
class ControlLock {
public:
    explicit ControlLock(Controller &controller) { controller.obey_requests(); }

private:
    const TickLock lock_;
};
