/* What the harness is checked with: a firmware whose every pulse is known to the cycle.
 *
 * Bytes on USART0 (57600 baud): `p` makes a pulse of 24002 cycles on B7 and one of 16002 on L5, `f` turns
 * B7 over 50000 times, `i` answers the level of A0, `w` drives OC4A with 8-bit phase-correct PWM at 64/255,
 * `t` stores beyond the RAM, `j` jumps beyond the flash, `z` sleeps for ever; any other byte is sent back
 * plus one.
 */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

static void send(uint8_t byte)
{
    while (!(UCSR0A & _BV(UDRE0))) {
    }
    UDR0 = byte;
}

static void pulse(void)
{
    /* From the end of one store (2 cycles) to the end of the next: the delay and that store. */
    PORTB |= _BV(PB7);
    __builtin_avr_delay_cycles(24000);
    PORTB &= ~_BV(PB7);
    PORTL = _BV(PL5);
    __builtin_avr_delay_cycles(16000);
    PORTL = 0;
}

static void flicker(void)
{
    for (uint16_t i = 0; i < 50000; i++) {
        PINB = _BV(PB7);
    }
}

static void jump_beyond_the_flash(void)
{
    __asm__ volatile("ldi r30, 0xFF\n\t"
                     "ldi r31, 0xFF\n\t"
                     "ldi r24, 0xFF\n\t"
                     "out %0, r24\n\t"
                     "eijmp" ::"I"(_SFR_IO_ADDR(EIND)) : "r24", "r30", "r31");
}

static void drive_pwm(void)
{
    DDRH |= _BV(PH3);
    TCCR4A = _BV(COM4A1) | _BV(WGM40);
    TCCR4B = _BV(CS41) | _BV(CS40);
    OCR4A = 64;
}

static void obey(uint8_t byte)
{
    switch (byte) {
    case 'p': pulse(); break;
    case 'f': flicker(); break;
    case 'i': send('0' + (PINA & _BV(PA0))); break;
    case 'w': drive_pwm(); break;
    case 't': *(volatile uint8_t *)0xFFF0 = 1; break;
    case 'j': jump_beyond_the_flash(); break;
    case 'z':
        cli();
        sleep_enable();
        sleep_cpu();
        break;
    default: send(byte + 1);
    }
}

int main(void)
{
    DDRB = _BV(PB7);
    DDRL = _BV(PL5);
    UBRR0 = F_CPU / 16 / 57600 - 1;
    UCSR0B = _BV(RXEN0) | _BV(TXEN0);
    for (;;) {
        if (UCSR0A & _BV(RXC0)) {
            obey(UDR0);
        }
    }
}
