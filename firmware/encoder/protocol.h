// Lines with sequence number and CRC: what comes in is checked here, what goes out is queued here.
#pragma once

#include "commands.h"
#include "config.h"
#include "controller.h"
#include "line_reader.h"
#include "text.h"

class Protocol {
public:
    explicit Protocol(Controller &controller) : controller_(controller), commands_(controller) {}

    void begin();

    // Each turn of the main loop. Nothing is begun that the line out has no room for, so nothing waits:
    // a host that asks faster than we answer fills the receive queue and hears of the overrun.
    void turn();

private:
    void send_events();
    void send_pins();
    void send_status();
    void take_lines();
    void handle(const char *line, uint8_t length);
    void note_overrun();
    void reject(PGM_P code_and_text);
    void send(Writer &line);

    Controller &controller_;
    Commands commands_;
    LineReader reader_;
    uint32_t status_due_ = 0;

    // The last line that was carried out, and its answer.
    bool remembered_ = false;
    uint16_t last_seq_ = 0;
    uint16_t last_crc_ = 0;
    char answer_bytes_[ANSWER_MAX + 1];
    Writer answer_{answer_bytes_, sizeof answer_bytes_};
};
