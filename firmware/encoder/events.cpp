#include "events.h"

namespace {

PGM_P fault_word(uint8_t fault) {
    switch (fault) {
    case FAULT_STALL: return PSTR("STALL");
    case FAULT_FOLLOW: return PSTR("FOLLOW");
    case FAULT_ENCODER: return PSTR("ENCODER");
    case FAULT_HOMING: return PSTR("HOMING");
    case FAULT_LIMIT: return PSTR("LIMIT");
    default: return PSTR("LOST");
    }
}

PGM_P failure_word(uint8_t failure) {
    switch (static_cast<HomingFailure>(failure)) {
    case HomingFailure::NOT_FOUND: return PSTR("notfound");
    case HomingFailure::STUCK: return PSTR("stuck");
    default: return PSTR("timeout");
    }
}

} // namespace

void write_event(Writer &line, const Event &event) {
    line.text(PSTR("! "));
    switch (event.kind) {
    case EventKind::HOMED:
        line.text(PSTR("homed "));
        line.number(event.axis);
        break;
    case EventKind::HOME_DONE: line.text(PSTR("home done")); break;
    case EventKind::HOME_FAILED:
        line.text(PSTR("home failed "));
        line.number(event.axis);
        line.put(' ');
        line.text(failure_word(event.detail));
        break;
    case EventKind::TRIP:
        line.text(PSTR("trip "));
        line.number(event.axis);
        line.put(' ');
        line.text(fault_word(event.detail));
        break;
    case EventKind::WATCHDOG: line.text(PSTR("watchdog")); break;
    case EventKind::STOPPED: line.text(PSTR("stopped")); break;
    case EventKind::HELD: line.text(PSTR("held")); break;
    }
    line.seal();
}
