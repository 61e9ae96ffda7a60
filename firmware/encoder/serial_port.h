// The serial line to the host: both directions run in interrupts, nothing here waits.
#pragma once

#include <stdint.h>

namespace serial_port {

void begin();

bool received();
char take(); // only when received()
// 0x18 or `!` came after the byte that was taken last: they act at once, and overtake lines.
bool stopped_since();

// Room for bytes to be sent; send() of more than that would lose some.
uint8_t room();
void send(const char *bytes, uint8_t count);

// A byte was lost or damaged on the way in, since the last call.
bool take_overrun();
// The host has asked for a status with '?'; once for each.
bool take_status_request();

// What single bytes asked of the control, since the last call. Called by the control tick only.
struct Requests {
    bool stop;    // 0x18; the motors are off already
    bool hold;    // '!'
    bool release; // '~'
};
Requests take_requests();

} // namespace serial_port
