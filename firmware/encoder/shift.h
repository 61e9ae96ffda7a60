// Shifts of 32-bit numbers by constants. The compiler makes a loop of single bits out of x >> 10, 70
// cycles and more; in bytes first it is 20. The control tick is full of them.
#pragma once

#include <stdint.h>

template <uint8_t Bits>
inline int32_t shifted_up(int32_t value) {
    static_assert(Bits >= 8 && Bits < 24, "by a byte or two and some bits");
    value *= Bits >= 16 ? 65536L : 256L;
    asm("" : "+r"(value)); // or it would be put together again
    return value * (1L << (Bits % 8));
}

template <uint8_t Bits>
inline int32_t shifted_down(int32_t value) {
    static_assert(Bits >= 8 && Bits < 24, "by a byte or two and some bits");
    value >>= Bits >= 16 ? 16 : 8;
    asm("" : "+r"(value));
    return value >> (Bits % 8);
}
