#include "homing.h"

namespace {

constexpr int32_t CLEARANCE = 40; // counts by which the joint goes off the switch or the stop
constexpr int32_t SPARE_WAY = 200;
constexpr uint32_t SPARE_TICKS = 5UL * TICK_HZ;
constexpr uint16_t PARK_TICKS = TICK_HZ / 2;
constexpr uint16_t SLOWEST = 30; // counts/s

uint16_t part(uint16_t velocity, uint8_t divisor) {
    const uint16_t slow = velocity / divisor;
    if (slow >= SLOWEST) return slow;
    return velocity < SLOWEST ? velocity : SLOWEST;
}

} // namespace

void Homing::begin(Axes &axes, uint8_t wanted) {
    wanted_ = 0;
    for (uint8_t axis = 0; axis < AXES; ++axis) {
        if ((wanted >> axis & 1) && axes.settings(axis).used()) wanted_ |= static_cast<uint8_t>(1 << axis);
    }
    started_ = false;
    state_ = SEARCH;
}

// The lowest place in the order; of equals the lowest axis.
bool Homing::next_axis(Axes &axes, const Switches &switches) {
    uint8_t best = NO_AXIS;
    for (uint8_t axis = 0; axis < AXES; ++axis) {
        if (!(wanted_ >> axis & 1)) continue;
        if (best == NO_AXIS || axes.settings(axis).home_order < axes.settings(best).home_order) best = axis;
    }
    if (best == NO_AXIS) return false;
    axis_ = best;
    wanted_ &= static_cast<uint8_t>(~(1 << best));
    started_ = true;
    touching_ = false;
    const Settings &settings = axes.settings(axis_);
    const int8_t toward = settings.home_direction;
    sighted_ = axes.position(axis_);
    if (!settings.home_by_stall && (switches.pressed() >> axis_ & 1)) {
        go(axes, RETREAT, static_cast<int8_t>(-toward), part(settings.home_velocity, 2));
    } else {
        go(axes, SEARCH, toward, settings.home_velocity);
    }
    return true;
}

void Homing::go(Axes &axes, State state, int8_t direction, uint16_t velocity) {
    const Settings &settings = axes.settings(axis_);
    if (velocity > settings.velocity) velocity = settings.velocity;
    const int32_t span = settings.high - settings.low;
    state_ = state;
    direction_ = direction;
    from_ = axes.position(axis_);
    way_limit_ = span + span / 8 + SPARE_WAY;
    ticks_left_ = static_cast<uint32_t>(way_limit_) / velocity * (2UL * TICK_HZ) + SPARE_TICKS;
    axes.profile(axis_).run_at(static_cast<int16_t>(direction * static_cast<int16_t>(velocity)));
}

Homing::Outcome Homing::step(Axes &axes, const Switches &switches, DriveWatch::Verdict verdict) {
    if (!started_) {
        if (next_axis(axes, switches)) return GOING_ON;
        state_ = IDLE;
        return DONE;
    }
    if (state_ == PARK) return park(axes);

    Profile &profile = axes.profile(axis_);
    const int32_t position = axes.position(axis_);
    const int32_t slack = axes.settings(axis_).following / 2;
    // A setpoint that runs away from a joint at its stop would be a following error.
    profile.stay_near(position, slack);
    // The leg begins where the joint has turned round.
    if (profile.velocity() * direction_ < 0) from_ = position;
    const int32_t way = (position - from_) * direction_;
    if (way < -slack) return RUNAWAY;
    if (verdict != DriveWatch::FINE) return on_stall(axes, verdict);
    if (!ticks_left_--) return fail(HomingFailure::TIMEOUT);
    if (way > way_limit_) return fail(state_ == RETREAT ? HomingFailure::STUCK : HomingFailure::NOT_FOUND);

    const bool pressed = switches.pressed() >> axis_ & 1;
    switch (state_) {
    case RETREAT: return retreat(axes, pressed);
    case APPROACH: return approach(axes, switches);
    default: return search(axes, pressed);
    }
}

Homing::Outcome Homing::search(Axes &axes, bool pressed) {
    const Settings &settings = axes.settings(axis_);
    if (settings.home_by_stall || !pressed) return GOING_ON;
    sighted_ = axes.position(axis_);
    go(axes, RETREAT, static_cast<int8_t>(-settings.home_direction), part(settings.home_velocity, 2));
    return GOING_ON;
}

// Off the switch, and past where it was first met: the joint may have run over it and out again.
Homing::Outcome Homing::retreat(Axes &axes, bool pressed) {
    const Settings &settings = axes.settings(axis_);
    const int32_t clear = (sighted_ - axes.position(axis_)) * settings.home_direction;
    if (clear < CLEARANCE || (pressed && !settings.home_by_stall)) return GOING_ON;
    touching_ = false;
    go(axes, APPROACH, settings.home_direction, part(settings.home_velocity, 8));
    return GOING_ON;
}

// The edge is where the contact first closed, not where it has stopped bouncing.
Homing::Outcome Homing::approach(Axes &axes, const Switches &switches) {
    if (axes.settings(axis_).home_by_stall) return GOING_ON;
    const bool touched = switches.touched() >> axis_ & 1;
    if (touched && !touching_) edge_ = axes.position(axis_);
    touching_ = touched;
    return switches.pressed() >> axis_ & 1 ? take_home(axes, edge_) : GOING_ON;
}

Homing::Outcome Homing::on_stall(Axes &axes, DriveWatch::Verdict verdict) {
    const Settings &settings = axes.settings(axis_);
    axes.relax(axis_);
    if (state_ == SEARCH) {
        sighted_ = axes.position(axis_);
        const int8_t back = static_cast<int8_t>(-settings.home_direction);
        if (settings.home_by_stall) go(axes, RETREAT, back, part(settings.home_velocity, 2));
        else go(axes, SEARCH_BACK, back, settings.home_velocity);
        return GOING_ON;
    }
    if (verdict == DriveWatch::SILENT) return NO_COUNTS;
    if (state_ == APPROACH && settings.home_by_stall) return take_home(axes, axes.position(axis_));
    return fail(state_ == SEARCH_BACK ? HomingFailure::NOT_FOUND : HomingFailure::STUCK);
}

Homing::Outcome Homing::take_home(Axes &axes, int32_t edge) {
    const int32_t home = axes.settings(axis_).home_position;
    axes.recount(axis_, edge, home);
    axes.profile(axis_).go_to(home, 1);
    state_ = PARK;
    ticks_left_ = PARK_TICKS;
    return GOING_ON;
}

Homing::Outcome Homing::park(Axes &axes) {
    if (!axes.profile(axis_).at_rest()) return GOING_ON;
    const int32_t off = axes.following_error(axis_);
    if (off >= -1 && off <= 1) ticks_left_ = 0; // as near as control comes
    if (ticks_left_) {
        --ticks_left_;
        return GOING_ON;
    }
    started_ = false;
    return AXIS_HOMED;
}

Homing::Outcome Homing::fail(HomingFailure failure) {
    failure_ = failure;
    return FAILED;
}
