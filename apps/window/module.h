// SPDX-License-Identifier: MIT
#pragma once

#include "window.h"

// The functions that tarsier-window.so exports. It is loaded at run time, so that only programs
// that open a window load a toolkit. The program and the module must come from the same build: the
// program refuses a module of another version.
extern "C" {
const char* tarsier_window_version();
// Throws tarsier::Error if there is no display.
void tarsier_window_check_display();
// The caller owns the window.
tarsier::window::Window* tarsier_window_open(const tarsier::window::WindowOptions* options);
}
