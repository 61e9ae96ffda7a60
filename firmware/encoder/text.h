// Numbers and words in lines of text, with bounds on both sides.
#pragma once

#include <avr/pgmspace.h>
#include <stdint.h>

// Writes into a buffer of fixed size; what does not fit is left out and remembered.
class Writer {
public:
    Writer(char *buffer, uint8_t size) : buffer_(buffer), size_(size) {}

    void put(char c);
    void text(PGM_P words);
    void number(int32_t value);
    void unsigned_number(uint32_t value);
    // A blank before it.
    void next_number(int32_t value);
    void hex1(uint8_t value); // lower case
    void hex2(uint8_t value);
    // Ends the line: its CRC and the line feed.
    void seal();

    uint8_t length() const { return length_; }
    void clear() { length_ = 0; }
    const char *begin() const { return buffer_; }

private:
    char *buffer_;
    uint8_t size_;
    uint8_t length_ = 0;
};

// Reads words of a line one after the other. Words are separated by single blanks or more.
class Scanner {
public:
    Scanner(const char *begin, uint8_t length) : at_(begin), end_(begin + length) {}

    // False at the end of the line.
    bool next();
    const char *word() const { return word_; }
    uint8_t length() const { return static_cast<uint8_t>(at_ - word_); }
    bool is(PGM_P words) const;

    // The word as a decimal number; false if it is none or has more than 9 digits.
    bool number(int32_t &value) const { return number(word_, at_, value); }
    bool number_in(int32_t low, int32_t high, int32_t &value) const;
    static bool number(const char *begin, const char *end, int32_t &value);

private:
    const char *at_;
    const char *end_;
    const char *word_ = nullptr;
};

// The value of four upper-case hexadecimal digits; false if they are not.
bool read_hex4(const char *digits, uint16_t &value);
