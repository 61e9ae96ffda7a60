#include "pins.h"

#include <avr/io.h>

#include "config.h"

namespace {

// A contact that bounces must not fill the line.
constexpr uint8_t NEWS_TICKS = ms_to_ticks(10) - 1;

uint8_t bit(uint8_t index) { return static_cast<uint8_t>(0x80 >> index); }

void write(uint8_t mask, bool high) {
    if (high) PORTL |= mask;
    else PORTL &= static_cast<uint8_t>(~mask);
}

} // namespace

void Pins::use(uint8_t index, PinUse use, PinLoss loss, bool high) {
    const uint8_t mask = bit(index);
    losses_[index] = loss;
    if (use == uses_[index]) return;
    uses_[index] = use;
    if (use == PinUse::OUT) {
        write(mask, high); // first: it is never at the other level
        DDRL |= mask;
    } else {
        DDRL &= static_cast<uint8_t>(~mask);
        write(mask, use == PinUse::UP);
    }
    used_ = static_cast<uint8_t>(use == PinUse::OFF ? used_ & ~mask : used_ | mask);
    inputs_ = static_cast<uint8_t>(use == PinUse::IN || use == PinUse::UP ? inputs_ | mask : inputs_ & ~mask);
    asm volatile("nop\n nop\n"); // a pull-up takes a little; the synchroniser two cycles
    before_ = static_cast<uint8_t>((before_ & ~mask) | (PINL & used_ & mask));
    changes_[index] = before_ & mask ? 1 : 0;
}

void Pins::set(uint8_t index, bool high) { write(bit(index), high); }

void Pins::sample(uint8_t ticks) {
    const uint8_t now = PINL & used_;
    uint8_t changed = now ^ before_;
    before_ = now;
    if (changed & inputs_) news_ = true;
    told_ago_ = static_cast<uint8_t>(ticks < NEWS_TICKS - told_ago_ ? told_ago_ + ticks : NEWS_TICKS);
    for (uint8_t index = 0; changed; ++index, changed = static_cast<uint8_t>(changed << 1)) {
        if (changed & 0x80) ++changes_[index];
    }
    const uint16_t silent = static_cast<uint16_t>(silent_ + ticks);
    silent_ = silent < silent_ ? 0xFFFF : silent;
    if (silent_ < patience_) lost_ = false;
    else if (!lost_) lose_host();
}

bool Pins::has_news() const { return news_ && told_ago_ >= NEWS_TICKS; }

bool Pins::take_news() {
    if (!has_news()) return false;
    news_ = false;
    told_ago_ = 0;
    return true;
}

// Once a silence: what a host sets later stays.
void Pins::lose_host() {
    lost_ = true;
    for (uint8_t index = 0; index < PINS; ++index) {
        if (is_output(index) && losses_[index] != PinLoss::KEEP) set(index, losses_[index] == PinLoss::HIGH);
    }
}
