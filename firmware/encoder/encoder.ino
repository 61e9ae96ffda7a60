// armctl's firmware for arms whose motors have encoders. Everything is in the .cpp files beside this
// one; main.cpp has main(), which takes the place of the Arduino core's. This file only has to exist
// for the Arduino IDE to take the folder as a sketch.
