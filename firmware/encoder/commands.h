// What the host can ask for, one function a command.
#pragma once

#include "controller.h"
#include "text.h"

class Commands {
public:
    explicit Commands(Controller &controller) : controller_(controller) {}

    // Carry out "CMD args" and write "ok ..." or "err CODE text".
    void run(Scanner &words, Writer &answer);

private:
    void hello(Scanner &words, Writer &answer);
    void cfg(Scanner &words, Writer &answer);
    void show(Scanner &words, Writer &answer);
    void pair(Scanner &words, Writer &answer);
    void wd(Scanner &words, Writer &answer);
    void en(Scanner &words, Writer &answer);
    void home(Scanner &words, Writer &answer);
    void p(Scanner &words, Writer &answer);
    void get(Scanner &words, Writer &answer);
    void clr(Scanner &words, Writer &answer);
    void ping(Scanner &words, Writer &answer);
    void pin(Scanner &words, Writer &answer);
    void set(Scanner &words, Writer &answer);

    struct Entry;
    static const Entry TABLE[];

    bool set_value(Scanner &words, Settings &settings, Writer &answer);
    bool setpoints_allowed(const int32_t *counts, uint8_t given, Writer &answer);

    Controller &controller_;
};
