// What the host tells about an axis with CFG.
#pragma once

#include <avr/pgmspace.h>
#include <stdint.h>

struct Settings {
    int32_t low;             // min: soft limits [counts]
    int32_t high;            // max
    int32_t home_position;   // hpos: what the switch's edge counts
    uint16_t velocity;       // vmax [counts/s]
    uint16_t acceleration;   // amax [counts/s2]
    uint16_t p;              // kp [1/256 PWM a count]
    uint16_t i;              // ki [1/256 PWM a count second]
    uint16_t d;              // kd [1/256 PWM a count a second]
    uint16_t following;      // ferr: following error that trips [counts]
    uint16_t stall_ms;       // stall: drive without movement that trips
    uint16_t home_velocity;  // hv [counts/s]
    uint8_t breakaway;       // brk: drive below which a standing motor does not move
    int8_t home_direction;   // hdir: where the switch is
    uint8_t home_order;      // hord: place in the homing order; 0 = axis not used
    uint8_t home_by_stall;   // hmode
    uint8_t encoder_inverted; // inv
    uint8_t motor_inverted;  // minv
    uint8_t switch_opens;    // sinv
    uint8_t drive_limit;     // dmax: the largest drive that the motor is given

    bool used() const { return home_order != 0; }
};

// One setting by its name in the protocol.
class SettingKey {
public:
    static constexpr uint8_t COUNT = 19;
    static constexpr uint8_t NAME_SIZE = 6;

    explicit SettingKey(uint8_t index) : index_(index) {}
    // The key with this name; false if there is none.
    static bool find(const char *name, uint8_t length, SettingKey &found);

    void name(char *buffer) const; // NAME_SIZE bytes
    int32_t low() const;
    int32_t high() const;
    int32_t get(const Settings &settings) const;
    // False, and nothing set, when the value is out of its range.
    bool set(Settings &settings, int32_t value) const;

private:
    uint8_t index_;
};

// True when homes found with one are no longer true with the other.
bool homes_differ(const Settings &a, const Settings &b);
// True when the motor's counts or its drive go the other way; of a pair, that concerns both joints.
bool motors_differ(const Settings &a, const Settings &b);

Settings default_settings(uint8_t axis);
