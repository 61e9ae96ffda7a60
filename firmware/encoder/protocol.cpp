#include "protocol.h"

#include <string.h>

#include "crc16.h"
#include "reset_cause.h"
#include "serial_port.h"
#include "status.h"

namespace {

constexpr uint8_t EVENT_MAX = 48;
constexpr uint8_t STATUS_MAX = 121;
constexpr uint16_t STATUS_TICKS = ms_to_ticks(STATUS_EVERY_MS) - 1; // 10 ticks are 19.5 ms

} // namespace

void Protocol::begin() {
    char bytes[80];
    Writer line(bytes, sizeof bytes);
    line.text(PSTR("# " BANNER_HEAD));
    line.text(reset_cause::name());
    line.seal();
    send(line);
}

void Protocol::turn() {
    send_events();
    send_pins();
    send_status();
    take_lines();
}

void Protocol::send(Writer &line) { serial_port::send(line.begin(), line.length()); }

void Protocol::send_events() {
    EventQueue &events = controller_.events();
    while (!events.empty() && serial_port::room() >= EVENT_MAX) {
        char bytes[EVENT_MAX];
        Writer line(bytes, sizeof bytes);
        write_event(line, events.take());
        send(line);
    }
}

// An input has changed: told at once, not with the next status.
void Protocol::send_pins() {
    if (!controller_.pins().has_news() || serial_port::room() < EVENT_MAX) return;
    {
        const TickLock lock;
        if (!controller_.pins().take_news()) return;
    }
    char bytes[EVENT_MAX];
    Writer line(bytes, sizeof bytes);
    line.text(PSTR("! pins "));
    write_pins(line, controller_);
    line.seal();
    send(line);
}

void Protocol::send_status() {
    uint32_t now;
    {
        const TickLock lock;
        now = controller_.ticks();
    }
    const bool due = now - status_due_ < 0x80000000UL;
    // One that is asked for leaves room for an answer: a flood of '?' does not keep lines waiting.
    if (!due && (serial_port::room() <= STATUS_MAX + ANSWER_MAX || !serial_port::take_status_request())) return;
    if (due) {
        // One that finds no room is left out, not sent late.
        status_due_ += STATUS_TICKS;
        if (now - status_due_ < 0x80000000UL) status_due_ = now + STATUS_TICKS;
    }
    if (serial_port::room() < STATUS_MAX) return;
    if (serial_port::take_overrun()) note_overrun();
    char bytes[STATUS_MAX];
    Writer line(bytes, sizeof bytes);
    line.text(PSTR("@ "));
    write_status(line, controller_);
    line.seal();
    send(line);
}

void Protocol::take_lines() {
    while (serial_port::received() && serial_port::room() > ANSWER_MAX) {
        switch (reader_.take(serial_port::take())) {
        case LineReader::PART: break;
        case LineReader::LINE:
            handle(reader_.line(), reader_.length());
            return; // one a turn: events and status are due in between
        case LineReader::TOO_LONG:
            note_overrun();
            reject(PSTR("LONG more than 96 bytes"));
            return;
        }
    }
}

void Protocol::note_overrun() {
    const TickLock lock;
    controller_.note_overrun();
}

void Protocol::reject(PGM_P code_and_text) {
    char bytes[48];
    Writer line(bytes, sizeof bytes);
    line.text(PSTR("0 err "));
    line.text(code_and_text);
    line.seal();
    send(line);
}

void Protocol::handle(const char *line, uint8_t length) {
    const uint8_t body = length < 5 ? 0 : length - 5;
    uint16_t crc;
    if (length < 5 || line[body] != '*' || !read_hex4(line + body + 1, crc) || crc16(line, body) != crc) {
        return reject(PSTR("CRC line ignored"));
    }
    {
        const TickLock lock;
        controller_.feed_watchdog();
    }
    reset_cause::heard();
    Scanner words(line, body);
    int32_t seq;
    if (!words.next() || !words.number_in(1, 65535, seq)) return reject(PSTR("SYNTAX seq 1 65535"));

    const bool again = remembered_ && static_cast<uint16_t>(seq) == last_seq_ && crc == last_crc_;
    if (!again) {
        answer_.clear();
        answer_.unsigned_number(static_cast<uint32_t>(seq));
        answer_.put(' ');
        commands_.run(words, answer_);
        answer_.seal();
        remembered_ = true;
        last_seq_ = static_cast<uint16_t>(seq);
        last_crc_ = crc;
    }
    send(answer_);
}
