#include "profile.h"

namespace {

// Up to 100 ms a setpoint is taken for one of a stream.
constexpr uint16_t STREAM_TICKS = ms_to_ticks(100);

int32_t fine(int32_t count) { return shifted_up<TICK_SHIFT>(count); }

} // namespace

void Profile::limit(int32_t low, int32_t high, uint16_t velocity, uint16_t acceleration) {
    low_ = fine(low);
    high_ = fine(high);
    velocity_limit_ = static_cast<int16_t>(velocity);
    velocity_limit_fine_ = fine(velocity_limit_);
    acceleration_ = acceleration;
    // v2 / 2a, and a quarter more for what must_brake() keeps back.
    const uint32_t way = static_cast<uint32_t>(velocity) * velocity / acceleration;
    longest_stop_ = way < 3000000UL ? fine(static_cast<int32_t>(way / 2 + way / 8 + 1)) : 0x7FFFFFFFL;
}

void Profile::stand_at(int32_t count) {
    position_ = line_ = goal_ = fine(count);
    velocity_ = 0;
    line_step_ = 0;
    line_ticks_ = 0;
    line_velocity_ = 0;
    following_ = true;
}

void Profile::go_to(int32_t count, uint16_t ticks) {
    if (!following_) line_ = position_;
    following_ = true;
    goal_ = fine(count);
    line_ticks_ = ticks;
    line_step_ = (goal_ - line_) / ticks;
    ends_at_rest_ = ticks > STREAM_TICKS;
}

void Profile::run_at(int16_t velocity) {
    following_ = false;
    velocity_goal_ = fine(velocity);
    velocity_step_ = acceleration_;
}

void Profile::brake(uint16_t ticks) {
    following_ = false;
    velocity_goal_ = 0;
    velocity_step_ = (velocity_ < 0 ? -velocity_ : velocity_) / ticks + 1;
}

void Profile::step() {
    if (following_) follow();
    else change_velocity();
    if (velocity_) position_ += shifted_down<TICK_SHIFT>(velocity_);
}

void Profile::change_velocity() {
    if (velocity_ < velocity_goal_ - velocity_step_) velocity_ += velocity_step_;
    else if (velocity_ > velocity_goal_ + velocity_step_) velocity_ -= velocity_step_;
    else velocity_ = velocity_goal_;
}

void Profile::advance_line() {
    line_velocity_ = 0;
    if (!line_ticks_) return;
    if (--line_ticks_ == 0) {
        line_ = goal_;
        return;
    }
    line_ += line_step_;
    line_velocity_ = line_step_ > velocity_limit_    ? velocity_limit_
                     : line_step_ < -velocity_limit_ ? static_cast<int16_t>(-velocity_limit_)
                                                     : static_cast<int16_t>(line_step_);
}

// The soft limit ahead, or the goal of a move, is no farther than it takes to slow down. A stream that
// breaks off at speed would else carry the joint past its limit.
bool Profile::must_stop_here() const {
    if (!velocity_) return false;
    const bool upward = velocity_ > 0;
    int32_t left = upward ? high_ - position_ : position_ - low_;
    if (ends_at_rest_ && line_ticks_) {
        const int32_t to_goal = upward ? goal_ - position_ : position_ - goal_;
        if (to_goal < left) left = to_goal;
    } else if (left > longest_stop_) {
        return false;
    }
    const int16_t v = velocity();
    return left <= 0 || must_brake(static_cast<uint16_t>(upward ? v : -v), static_cast<uint32_t>(left));
}

void Profile::follow() {
    if (!line_ticks_ && !velocity_ && position_ == goal_) return;
    advance_line();
    const int32_t error = line_ - position_;
    const uint32_t distance = static_cast<uint32_t>(error < 0 ? -error : error);
    const int32_t faster = static_cast<int32_t>(velocity()) - line_velocity_; // than the line
    const uint16_t difference = static_cast<uint16_t>(faster < 0 ? -faster : faster);
    const bool stop = must_stop_here();

    // Close enough to be on the line: the rest of a tick's acceleration would only make it rattle.
    if (!stop && distance < (1 << TICK_SHIFT) / 4 && difference <= (acceleration_ >> (TICK_SHIFT - 1)) + 2) {
        velocity_ = fine(line_velocity_);
        position_ = line_ - line_velocity_; // step() adds it
        return;
    }
    const int32_t closing = error > 0 ? faster : -faster;
    const bool speed_up = closing <= 0 || !must_brake(static_cast<uint16_t>(closing), distance);
    const bool upward = stop ? velocity_ < 0 : (error > 0) == speed_up;
    velocity_ += upward ? static_cast<int32_t>(acceleration_) : -static_cast<int32_t>(acceleration_);
    if (velocity_ > velocity_limit_fine_) velocity_ = velocity_limit_fine_;
    else if (velocity_ < -velocity_limit_fine_) velocity_ = -velocity_limit_fine_;
}

// v2 / 2 >= 7/8 a s: time to brake. An eighth of the acceleration is kept back for what the ticks round.
// Two scales keep both sides in 32 bits: 1/16 count near the goal, whole counts beyond 4095.
bool Profile::must_brake(uint16_t v, uint32_t distance) const {
    const uint16_t a = static_cast<uint16_t>(acceleration_ - (acceleration_ >> 3));
    const uint32_t v2 = static_cast<uint32_t>(v) * v;
    const uint32_t sixteenths = distance >> (TICK_SHIFT - 4);
    if (sixteenths <= 0xFFFF) {
        return v > 23000 || v2 * 8 >= static_cast<uint32_t>(a) * static_cast<uint16_t>(sixteenths);
    }
    const uint32_t counts = static_cast<uint32_t>(shifted_down<TICK_SHIFT>(static_cast<int32_t>(distance)));
    const uint16_t near = counts > 0xFFFF ? 0xFFFF : static_cast<uint16_t>(counts);
    return v2 / 2 >= static_cast<uint32_t>(a) * near;
}

void Profile::shift(int32_t counts) {
    position_ += fine(counts);
    line_ += fine(counts);
    goal_ += fine(counts);
}

void Profile::stay_near(int32_t count, int32_t distance) {
    const int32_t low = fine(count - distance), high = fine(count + distance);
    if (position_ < low) position_ = low;
    else if (position_ > high) position_ = high;
}

bool Profile::at_rest() const {
    return velocity_ == 0 && (following_ ? !line_ticks_ && position_ == goal_ : velocity_goal_ == 0);
}
