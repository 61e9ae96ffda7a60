#include "pid.h"

#include "config.h"
#include "shift.h"

namespace {

constexpr uint8_t ERROR_SHIFT = 4; // errors are in 1/16 count
constexpr int16_t DEAD_BAND = 1 << ERROR_SHIFT;
// Beyond one and a half counts a motor that stands is pushed off; inside, the kick would overshoot.
constexpr int16_t WANTS_TO_MOVE = 3 << (ERROR_SHIFT - 1);
constexpr uint8_t LEAK_TICKS = 8;
constexpr uint8_t LEAK_SHIFT = 6; // 1/64 every 8 ticks: gone in about a second

int16_t clamped(int32_t value, int16_t limit) {
    if (value > limit) return limit;
    if (value < -limit) return static_cast<int16_t>(-limit);
    return static_cast<int16_t>(value);
}

} // namespace

void Pid::set(const Settings &settings) {
    p_ = settings.p;
    i_ = settings.i;
    d_ = settings.d;
    breakaway_ = settings.breakaway;
    limit_ = settings.drive_limit;
    // Where the integral alone drives fully: more of it would only have to be wound back.
    const int32_t full = (static_cast<int32_t>(limit_) << 8) << (TICK_SHIFT + ERROR_SHIFT);
    integral_limit_ = i_ ? full / i_ : 0;
}

void Pid::reset() {
    integral_ = 0;
    leak_ = 0;
    pushed_ = 0;
}

int16_t Pid::step(const Input &input) {
    const int32_t fine_error =
        (input.target - shifted_up<TICK_SHIFT>(input.count)) >> (TICK_SHIFT - ERROR_SHIFT);
    const int16_t error = clamped(fine_error, 0x7FFF);
    const int16_t late = clamped(static_cast<int32_t>(input.target_velocity) - input.velocity, 0x7FFF);

    // All terms in 1/256 PWM. i_ * integral_ stays below the full drive by the integral's limit.
    const int32_t proportional = (static_cast<int32_t>(p_) * error) >> ERROR_SHIFT;
    const int32_t integral = shifted_down<TICK_SHIFT + ERROR_SHIFT>(static_cast<int32_t>(i_) * integral_);
    const int32_t derivative = static_cast<int32_t>(d_) * late;
    const int16_t drive = clamped((proportional + integral + derivative) >> 8, limit_);

    const bool in_band = error <= DEAD_BAND && error >= -DEAD_BAND;
    integrate(error, in_band && input.target_velocity == 0, drive);

    return push_off(error, input, drive);
}

// Break-away: only of a motor that stands and should not. It begins with the drive that moves the free
// motor and grows, for a joint that has to lift something, until it moves or the largest drive says that
// it cannot.
int16_t Pid::push_off(int16_t error, const Input &input, int16_t drive) {
    const int16_t enough = input.exact ? WANTS_TO_MOVE / 2 : WANTS_TO_MOVE;
    const bool wants = error >= enough || error <= -enough;
    if (!breakaway_ || !input.standing || !wants) {
        pushed_ = 0;
        return drive;
    }
    int16_t push = static_cast<int16_t>(breakaway_ + pushed_);
    if (push < limit_) ++pushed_;
    else push = limit_;
    if (error > 0) return drive < push ? push : drive;
    return drive > -push ? static_cast<int16_t>(-push) : drive;
}

void Pid::integrate(int16_t error, bool resting, int16_t drive) {
    if (resting) {
        // There: what friction holds needs no current, so the integral fades. A load that pulls the
        // joint out of the band builds it up again.
        if (++leak_ >= LEAK_TICKS) {
            leak_ = 0;
            integral_ -= integral_ / (1 << LEAK_SHIFT);
        }
        return;
    }
    if ((drive >= limit_ && error > 0) || (drive <= -limit_ && error < 0)) return;
    integral_ += error;
    if (integral_ > integral_limit_) integral_ = integral_limit_;
    else if (integral_ < -integral_limit_) integral_ = -integral_limit_;
}
