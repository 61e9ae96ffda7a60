// CRC-16/IBM-3740: polynomial 0x1021 from 0xFFFF, nothing reflected. "123456789" gives 29B1.
#pragma once

#include <stdint.h>
#include <util/crc16.h>

inline uint16_t crc16(const char *bytes, uint8_t count) {
    uint16_t crc = 0xFFFF;
    while (count--) crc = _crc_xmodem_update(crc, static_cast<uint8_t>(*bytes++));
    return crc;
}
