#include "settings.h"

#include <stddef.h>
#include <string.h>

#include "config.h"

namespace {

enum Kind : uint8_t { BYTE, SIGNED_BYTE, WORD, LONG };

struct Row {
    char name[SettingKey::NAME_SIZE];
    uint8_t offset;
    Kind kind;
    int32_t low, high;
};

constexpr int32_t FAR = 1000000; // counts: in 1/512 count they and their differences fit 32 bits

#define AT(member) static_cast<uint8_t>(offsetof(Settings, member))

const Row ROWS[SettingKey::COUNT] PROGMEM = {
    {"min", AT(low), LONG, -FAR, FAR},
    {"max", AT(high), LONG, -FAR, FAR},
    {"vmax", AT(velocity), WORD, 1, FASTEST},
    {"amax", AT(acceleration), WORD, 1, 65535},
    {"kp", AT(p), WORD, 0, 32767},
    {"ki", AT(i), WORD, 0, 32767},
    {"kd", AT(d), WORD, 0, 32767},
    {"brk", AT(breakaway), BYTE, 0, 255},
    {"ferr", AT(following), WORD, 1, 30000},
    {"stall", AT(stall_ms), WORD, 20, 5000},
    {"hdir", AT(home_direction), SIGNED_BYTE, -1, 1},
    {"hv", AT(home_velocity), WORD, 1, FASTEST},
    {"hpos", AT(home_position), LONG, -FAR, FAR},
    {"hord", AT(home_order), BYTE, 0, 6},
    {"hmode", AT(home_by_stall), BYTE, 0, 1},
    {"inv", AT(encoder_inverted), BYTE, 0, 1},
    {"minv", AT(motor_inverted), BYTE, 0, 1},
    {"sinv", AT(switch_opens), BYTE, 0, 1},
    {"dmax", AT(drive_limit), BYTE, 1, FULL_DRIVE},
};

Row row(uint8_t index) {
    Row copy;
    memcpy_P(&copy, &ROWS[index], sizeof copy);
    return copy;
}

// A rebuilt Scorbot: 20-slot encoders on the motors' shafts; the base goes home last, the gripper (no
// switch) by stall. Order of the values: see Settings.
const Settings DEFAULTS[6] PROGMEM = {
    {-22000, 22000, 0, 2840, 11400, 1200, 2000, 16, 600, 300, 900, 200, 1, 6, 0, 0, 0, 0, 255},
    {-8000, 10800, 0, 2950, 11800, 1200, 2000, 16, 600, 300, 900, 200, 1, 2, 0, 0, 0, 0, 255},
    {-25600, 4000, 0, 2950, 11800, 1200, 2000, 16, 600, 300, 900, 200, 1, 3, 0, 0, 0, 0, 255},
    {-3900, 3400, 0, 2300, 9200, 2500, 4000, 26, 400, 300, 800, 200, 1, 4, 0, 0, 0, 0, 255},
    {-5100, 5100, 0, 2900, 11800, 2500, 4000, 26, 400, 300, 800, 200, 1, 5, 0, 0, 0, 0, 255},
    {0, 1700, 0, 1600, 8000, 1000, 1000, 13, 400, 200, 800, 200, -1, 1, 1, 0, 0, 0, 255},
};

} // namespace

bool SettingKey::find(const char *name, uint8_t length, SettingKey &found) {
    for (uint8_t i = 0; i < COUNT; ++i) {
        if (strlen_P(ROWS[i].name) == length && strncmp_P(name, ROWS[i].name, length) == 0) {
            found = SettingKey(i);
            return true;
        }
    }
    return false;
}

void SettingKey::name(char *buffer) const { strcpy_P(buffer, ROWS[index_].name); }

int32_t SettingKey::low() const { return row(index_).low; }

int32_t SettingKey::high() const { return row(index_).high; }

int32_t SettingKey::get(const Settings &settings) const {
    const Row key = row(index_);
    const void *at = reinterpret_cast<const uint8_t *>(&settings) + key.offset;
    switch (key.kind) {
    case BYTE: return *static_cast<const uint8_t *>(at);
    case SIGNED_BYTE: return *static_cast<const int8_t *>(at);
    case WORD: return *static_cast<const uint16_t *>(at);
    default: return *static_cast<const int32_t *>(at);
    }
}

bool SettingKey::set(Settings &settings, int32_t value) const {
    const Row key = row(index_);
    if (value < key.low || value > key.high) return false;
    if (key.kind == SIGNED_BYTE && value == 0) return false; // a direction
    void *at = reinterpret_cast<uint8_t *>(&settings) + key.offset;
    switch (key.kind) {
    case BYTE: *static_cast<uint8_t *>(at) = static_cast<uint8_t>(value); break;
    case SIGNED_BYTE: *static_cast<int8_t *>(at) = static_cast<int8_t>(value); break;
    case WORD: *static_cast<uint16_t *>(at) = static_cast<uint16_t>(value); break;
    default: *static_cast<int32_t *>(at) = value;
    }
    return true;
}

bool homes_differ(const Settings &a, const Settings &b) {
    return a.home_position != b.home_position || a.home_direction != b.home_direction ||
           a.home_by_stall != b.home_by_stall || a.switch_opens != b.switch_opens || motors_differ(a, b) ||
           !a.used() || !b.used();
}

bool motors_differ(const Settings &a, const Settings &b) {
    return a.encoder_inverted != b.encoder_inverted || a.motor_inverted != b.motor_inverted;
}

Settings default_settings(uint8_t axis) {
    Settings copy;
    memcpy_P(&copy, &DEFAULTS[axis], sizeof copy);
    return copy;
}
