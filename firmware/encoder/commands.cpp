#include "commands.h"

#include <string.h>

#include "config.h"
#include "reset_cause.h"
#include "status.h"

namespace {

void ok(Writer &answer) { answer.text(PSTR("ok")); }

void refuse(Writer &answer, PGM_P code_and_text) {
    answer.text(PSTR("err "));
    answer.text(code_and_text);
}

// Reads an axis number; refuses anything else.
bool read_axis(Scanner &words, uint8_t &axis, Writer &answer) {
    int32_t number;
    if (!words.next() || !words.number(number)) {
        refuse(answer, PSTR("ARGS axis missing"));
        return false;
    }
    if (number < 0 || number >= AXES) {
        refuse(answer, PSTR("RANGE axis 0 5"));
        return false;
    }
    axis = static_cast<uint8_t>(number);
    return true;
}

// Reads the number of a spare pin; refuses anything else.
bool read_pin(Scanner &words, uint8_t &index, Writer &answer) {
    int32_t number;
    if (!words.next() || !words.number(number)) {
        refuse(answer, PSTR("ARGS pin missing"));
        return false;
    }
    if (number < FIRST_PIN || number >= FIRST_PIN + PINS) {
        refuse(answer, PSTR("RANGE pin 42 49"));
        return false;
    }
    index = static_cast<uint8_t>(number - FIRST_PIN);
    return true;
}

// The place of a word in a list; the length of the list where it is none of them.
uint8_t place_of(const Scanner &words, const char (*list)[5], uint8_t length) {
    uint8_t place = 0;
    while (place < length && !words.is(list[place])) ++place;
    return place;
}

const char USES[][5] PROGMEM = {"off", "in", "up", "out"};
const char LOSSES[][5] PROGMEM = {"keep", "low", "high"};

bool at_end(Scanner &words, Writer &answer) {
    if (!words.next()) return true;
    refuse(answer, PSTR("ARGS too many"));
    return false;
}

// "err CODE axis", for refusals that are about one axis.
void refuse_axis(Writer &answer, PGM_P code, uint8_t axis) {
    refuse(answer, code);
    answer.next_number(axis);
}

} // namespace

struct Commands::Entry {
    char name[6];
    void (Commands::*run)(Scanner &, Writer &);
};

const Commands::Entry Commands::TABLE[] PROGMEM = {
    {"P", &Commands::p},       {"PING", &Commands::ping}, {"GET", &Commands::get},   {"EN", &Commands::en},
    {"HOME", &Commands::home}, {"CLR", &Commands::clr},   {"CFG", &Commands::cfg},   {"SHOW", &Commands::show},
    {"PAIR", &Commands::pair}, {"WD", &Commands::wd},     {"HELLO", &Commands::hello}, {"PIN", &Commands::pin},
    {"SET", &Commands::set},
};

void Commands::run(Scanner &words, Writer &answer) {
    if (!words.next()) {
        refuse(answer, PSTR("UNKNOWN no command"));
        return;
    }
    for (const Entry &row : TABLE) {
        if (!words.is(row.name)) continue;
        Entry entry;
        memcpy_P(&entry, &row, sizeof entry);
        (this->*entry.run)(words, answer);
        return;
    }
    refuse(answer, PSTR("UNKNOWN command"));
}

void Commands::hello(Scanner &words, Writer &answer) {
    if (!at_end(words, answer)) return;
    answer.text(PSTR("ok " BANNER_HEAD));
    answer.text(reset_cause::name());
}

// All values of a line, or none of them.
void Commands::cfg(Scanner &words, Writer &answer) {
    uint8_t axis;
    if (!read_axis(words, axis, answer)) return;
    const ControlLock lock(controller_);
    if (controller_.powered()) return refuse(answer, PSTR("MOVING motors are on"));
    Settings settings = controller_.axes().settings(axis);
    bool any = false;
    while (words.next()) {
        if (!set_value(words, settings, answer)) return;
        any = true;
    }
    if (!any) return refuse(answer, PSTR("ARGS key=value missing"));
    if (settings.low >= settings.high) return refuse(answer, PSTR("RANGE min not below max"));
    controller_.configure(axis, settings);
    ok(answer);
}

bool Commands::set_value(Scanner &words, Settings &settings, Writer &answer) {
    const char *word = words.word();
    const char *end = word + words.length();
    const char *equals = static_cast<const char *>(memchr(word, '=', words.length()));
    SettingKey key(0);
    int32_t value;
    if (!equals || !SettingKey::find(word, static_cast<uint8_t>(equals - word), key)) {
        refuse(answer, PSTR("ARGS unknown key"));
        return false;
    }
    if (!Scanner::number(equals + 1, end, value)) {
        refuse(answer, PSTR("ARGS not a number"));
        return false;
    }
    if (key.set(settings, value)) return true;
    char name[SettingKey::NAME_SIZE];
    key.name(name);
    refuse(answer, PSTR("RANGE "));
    for (const char *c = name; *c; ++c) answer.put(*c);
    answer.next_number(value);
    answer.next_number(key.low());
    answer.next_number(key.high());
    return false;
}

void Commands::show(Scanner &words, Writer &answer) {
    uint8_t axis;
    if (!read_axis(words, axis, answer)) return;
    int32_t part = 1;
    if (words.next() && !words.number_in(1, 2, part)) return refuse(answer, PSTR("RANGE part 1 2"));
    if (!at_end(words, answer)) return;
    constexpr uint8_t HALF = SettingKey::COUNT / 2;
    const Settings &settings = controller_.axes().settings(axis);
    ok(answer);
    for (uint8_t i = part == 1 ? 0 : HALF; i < (part == 1 ? HALF : SettingKey::COUNT); ++i) {
        const SettingKey key(i);
        char name[SettingKey::NAME_SIZE];
        key.name(name);
        answer.put(' ');
        for (const char *c = name; *c; ++c) answer.put(*c);
        answer.put('=');
        answer.number(key.get(settings));
    }
}

void Commands::pair(Scanner &words, Writer &answer) {
    uint8_t sum = NO_AXIS, difference = NO_AXIS;
    Scanner ahead = words;
    if (ahead.next() && ahead.is(PSTR("NONE"))) words = ahead;
    else if (!read_axis(words, sum, answer) || !read_axis(words, difference, answer)) return;
    if (!at_end(words, answer)) return;
    if (sum != NO_AXIS && sum == difference) return refuse(answer, PSTR("RANGE two axes"));
    const ControlLock lock(controller_);
    if (controller_.powered()) return refuse(answer, PSTR("MOVING motors are on"));
    controller_.pair(sum, difference);
    ok(answer);
}

void Commands::wd(Scanner &words, Writer &answer) {
    int32_t ms;
    if (!words.next() || !words.number(ms)) return refuse(answer, PSTR("ARGS ms missing"));
    if (!at_end(words, answer)) return;
    if (ms < WATCHDOG_MIN_MS || ms > WATCHDOG_MAX_MS) return refuse(answer, PSTR("RANGE ms 50 500"));
    const TickLock lock;
    controller_.set_watchdog_ms(static_cast<uint16_t>(ms));
    ok(answer);
}

void Commands::en(Scanner &words, Writer &answer) {
    int32_t on;
    if (!words.next() || !words.number(on)) return refuse(answer, PSTR("ARGS 0 or 1 missing"));
    if (!at_end(words, answer)) return;
    if (on < 0 || on > 1) return refuse(answer, PSTR("RANGE 0 1"));
    const ControlLock lock(controller_);
    if (!on) {
        controller_.switch_off();
        return ok(answer);
    }
    switch (controller_.mode()) {
    case Mode::TRIPPED: return refuse(answer, PSTR("FAULT latched"));
    case Mode::HOMING: return refuse(answer, PSTR("BUSY homing"));
    case Mode::HELD:
        if (controller_.switching_off()) return refuse(answer, PSTR("HOLD braking"));
        break; // on already
    case Mode::OFF:
        if (!controller_.switch_on()) return refuse(answer, PSTR("OFF stopped"));
        break;
    case Mode::ON: break;
    }
    ok(answer);
}

void Commands::home(Scanner &words, Writer &answer) {
    uint8_t wanted = 0;
    Scanner ahead = words;
    if (!ahead.next()) wanted = 0x3F;
    else {
        Scanner rest = words;
        while (rest.next()) {
            uint8_t axis;
            if (!read_axis(words, axis, answer)) return;
            wanted |= static_cast<uint8_t>(1 << axis);
        }
    }
    const ControlLock lock(controller_);
    switch (controller_.mode()) {
    case Mode::TRIPPED: return refuse(answer, PSTR("FAULT latched"));
    case Mode::HOMING: return refuse(answer, PSTR("BUSY homing"));
    case Mode::HELD: return refuse(answer, PSTR("HOLD"));
    case Mode::OFF:
    case Mode::ON: break;
    }
    for (uint8_t axis = 0; axis < AXES; ++axis) {
        const Settings &settings = controller_.axes().settings(axis);
        if (!(wanted >> axis & 1) || !settings.used()) continue;
        if (settings.home_position >= settings.low && settings.home_position <= settings.high) continue;
        return refuse_axis(answer, PSTR("RANGE hpos outside min max, axis"), axis);
    }
    if (!controller_.home(wanted)) return refuse(answer, PSTR("OFF stopped"));
    ok(answer);
}

void Commands::p(Scanner &words, Writer &answer) {
    int32_t counts[AXES];
    uint8_t given = 0;
    for (uint8_t axis = 0; axis < AXES; ++axis) {
        if (!words.next()) return refuse(answer, PSTR("ARGS six counts or -"));
        if (words.is(PSTR("-"))) continue;
        if (!words.number(counts[axis])) return refuse(answer, PSTR("ARGS not a number"));
        given |= static_cast<uint8_t>(1 << axis);
    }
    int32_t ms = 20;
    if (words.next()) {
        if (!words.number(ms)) return refuse(answer, PSTR("ARGS not a number"));
        if (ms < 1 || ms > 1000) return refuse(answer, PSTR("RANGE ms 1 1000"));
    }
    if (!at_end(words, answer)) return;
    const ControlLock lock(controller_);
    if (!setpoints_allowed(counts, given, answer)) return;
    for (uint8_t axis = 0; axis < AXES; ++axis) {
        if (given >> axis & 1) controller_.go_to(axis, counts[axis], ms_to_ticks(static_cast<uint32_t>(ms)));
    }
    ok(answer);
}

bool Commands::setpoints_allowed(const int32_t *counts, uint8_t given, Writer &answer) {
    switch (controller_.mode()) {
    case Mode::TRIPPED: refuse(answer, PSTR("FAULT latched")); return false;
    case Mode::HOMING: refuse(answer, PSTR("BUSY homing")); return false;
    case Mode::HELD: refuse(answer, PSTR("HOLD")); return false;
    case Mode::OFF: refuse(answer, PSTR("OFF")); return false;
    case Mode::ON: break;
    }
    for (uint8_t axis = 0; axis < AXES; ++axis) {
        if (!(given >> axis & 1) || controller_.homed(axis)) continue;
        refuse_axis(answer, PSTR("NOTHOMED"), axis);
        return false;
    }
    for (uint8_t axis = 0; axis < AXES; ++axis) {
        const Settings &settings = controller_.axes().settings(axis);
        if (!(given >> axis & 1) || (counts[axis] >= settings.low && counts[axis] <= settings.high)) continue;
        refuse_axis(answer, PSTR("LIMIT"), axis);
        answer.next_number(counts[axis]);
        answer.next_number(settings.low);
        answer.next_number(settings.high);
        return false;
    }
    return true;
}

void Commands::get(Scanner &words, Writer &answer) {
    if (!at_end(words, answer)) return;
    answer.text(PSTR("ok "));
    write_status(answer, controller_);
}

void Commands::clr(Scanner &words, Writer &answer) {
    if (!at_end(words, answer)) return;
    const ControlLock lock(controller_);
    controller_.clear_faults();
    ok(answer);
}

void Commands::ping(Scanner &words, Writer &answer) {
    if (at_end(words, answer)) ok(answer);
}

void Commands::pin(Scanner &words, Writer &answer) {
    uint8_t index;
    if (!read_pin(words, index, answer)) return;
    if (!words.next()) return refuse(answer, PSTR("ARGS off in up out"));
    const uint8_t use = place_of(words, USES, 4);
    if (use == 4) return refuse(answer, PSTR("ARGS off in up out"));
    uint8_t loss = 0;
    int32_t high = 0;
    if (words.next()) {
        loss = place_of(words, LOSSES, 3);
        if (loss == 3 || use != static_cast<uint8_t>(PinUse::OUT)) {
            return refuse(answer, PSTR("ARGS keep low high, of an output"));
        }
        if (words.next() && !words.number_in(0, 1, high)) return refuse(answer, PSTR("RANGE 0 1"));
    }
    if (!at_end(words, answer)) return;
    const TickLock lock;
    controller_.pins().use(index, static_cast<PinUse>(use), static_cast<PinLoss>(loss), high != 0);
    ok(answer);
}

void Commands::set(Scanner &words, Writer &answer) {
    uint8_t index;
    if (!read_pin(words, index, answer)) return;
    int32_t level;
    if (!words.next() || !words.number(level)) return refuse(answer, PSTR("ARGS 0 or 1 missing"));
    if (!at_end(words, answer)) return;
    if (level < 0 || level > 1) return refuse(answer, PSTR("RANGE 0 1"));
    const TickLock lock;
    if (!controller_.pins().is_output(index)) return refuse(answer, PSTR("NOTOUT"));
    controller_.pins().set(index, level != 0);
    ok(answer);
}
