#include "text.h"

#include <stdlib.h>
#include <string.h>

#include "crc16.h"

void Writer::put(char c) {
    if (length_ < size_) buffer_[length_++] = c;
}

void Writer::text(PGM_P words) {
    while (const char c = static_cast<char>(pgm_read_byte(words++))) put(c);
}

void Writer::number(int32_t value) {
    char digits[12];
    ltoa(value, digits, 10);
    for (const char *c = digits; *c; ++c) put(*c);
}

void Writer::unsigned_number(uint32_t value) {
    char digits[12];
    ultoa(value, digits, 10);
    for (const char *c = digits; *c; ++c) put(*c);
}

void Writer::next_number(int32_t value) {
    put(' ');
    number(value);
}

static char hex_digit(uint8_t value, char ten) {
    value &= 15;
    return static_cast<char>(value < 10 ? '0' + value : ten - 10 + value);
}

void Writer::hex1(uint8_t value) { put(hex_digit(value, 'a')); }

void Writer::hex2(uint8_t value) {
    hex1(value >> 4);
    hex1(value);
}

void Writer::seal() {
    // Room for "*CCCC\n" is taken from the text rather than lost: an answer cut short is still a line.
    if (length_ > size_ - 6) length_ = size_ - 6;
    const uint16_t crc = crc16(buffer_, length_);
    put('*');
    for (int8_t shift = 12; shift >= 0; shift -= 4) put(hex_digit(static_cast<uint8_t>(crc >> shift), 'A'));
    put('\n');
}

bool Scanner::next() {
    while (at_ < end_ && *at_ == ' ') ++at_;
    word_ = at_;
    while (at_ < end_ && *at_ != ' ') ++at_;
    return at_ > word_;
}

bool Scanner::is(PGM_P words) const {
    return strlen_P(words) == length() && strncmp_P(word_, words, length()) == 0;
}

bool Scanner::number(const char *begin, const char *end, int32_t &value) {
    const bool negative = begin < end && *begin == '-';
    if (negative) ++begin;
    if (begin == end || end - begin > 9) return false;
    int32_t sum = 0;
    for (; begin < end; ++begin) {
        if (*begin < '0' || *begin > '9') return false;
        sum = sum * 10 + (*begin - '0');
    }
    value = negative ? -sum : sum;
    return true;
}

bool Scanner::number_in(int32_t low, int32_t high, int32_t &value) const {
    return number(value) && value >= low && value <= high;
}

bool read_hex4(const char *digits, uint16_t &value) {
    value = 0;
    for (uint8_t i = 0; i < 4; ++i) {
        const char c = digits[i];
        uint8_t digit;
        if (c >= '0' && c <= '9') digit = static_cast<uint8_t>(c - '0');
        else if (c >= 'A' && c <= 'F') digit = static_cast<uint8_t>(c - 'A' + 10);
        else return false;
        value = static_cast<uint16_t>(value << 4 | digit);
    }
    return true;
}
