// A queue between one writer and one reader, of which one may be an interrupt. It holds Size - 1 items;
// Size is a power of two. Indexes are single bytes, so reading one is atomic on this CPU.
#pragma once

#include <stdint.h>

template <typename Item, uint16_t Size>
class Ring {
    static_assert(Size >= 2 && Size <= 256 && (Size & (Size - 1)) == 0, "a power of two up to 256");

public:
    bool empty() const { return head_ == tail_; }
    uint8_t room() const { return static_cast<uint8_t>((tail_ - head_ - 1) & MASK); }
    // Where the next item will be put, and where the next one is taken.
    uint8_t head() const { return head_; }
    uint8_t tail() const { return tail_; }

    // False when it is full: the item is not taken.
    bool put(Item item) {
        const uint8_t next = (head_ + 1) & MASK;
        if (next == tail_) return false;
        items_[head_] = item;
        in_order();
        head_ = next;
        return true;
    }

    // Only when not empty.
    Item take() {
        in_order();
        const Item item = items_[tail_];
        in_order();
        tail_ = (tail_ + 1) & MASK;
        return item;
    }

private:
    static constexpr uint8_t MASK = Size - 1;

    // An item is in its place before the index says so, whatever the compiler would rather do.
    static void in_order() { asm volatile("" ::: "memory"); }

    volatile uint8_t head_ = 0;
    volatile uint8_t tail_ = 0;
    Item items_[Size];
};
