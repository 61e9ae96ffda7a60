// The status line: everything the host watches, 50 times a second.
#pragma once

#include "controller.h"
#include "text.h"

// The fields without "@ " before and CRC after them. What was lost on the line is told once.
void write_pins(Writer &line, Controller &controller);
void write_status(Writer &line, Controller &controller);
