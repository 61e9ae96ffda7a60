// Collects bytes to lines of bounded length.
#pragma once

#include <stdint.h>

#include "config.h"

class LineReader {
public:
    enum Result : uint8_t { PART, LINE, TOO_LONG };

    Result take(char byte) {
        if (byte != '\n') {
            if (length_ <= LINE_MAX) line_[length_++] = byte; // one more than allowed: a '\r' may be last
            else dropped_ = true;
            return PART;
        }
        if (length_ && !dropped_ && line_[length_ - 1] == '\r') --length_;
        const bool too_long = dropped_ || length_ > LINE_MAX;
        finished_ = length_;
        length_ = 0;
        dropped_ = false;
        return too_long ? TOO_LONG : finished_ ? LINE : PART;
    }

    // Of the line that take() has just finished.
    const char *line() const { return line_; }
    uint8_t length() const { return finished_; }

private:
    char line_[LINE_MAX + 1];
    uint8_t length_ = 0;
    uint8_t finished_ = 0;
    bool dropped_ = false;
};
