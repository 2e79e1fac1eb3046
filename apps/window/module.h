// SPDX-License-Identifier: MIT
#pragma once

#include "window.h"

// What tarsier-window.so exports. It is loaded at run time, so that only those who open a window
// load a toolkit. Program and module are built together: the program refuses a module of another
// version.
extern "C" {
const char* tarsier_window_version();
// Throws tarsier::Error if there is no display to open a window on.
void tarsier_window_check_display();
// Owned by the caller.
tarsier::window::Window* tarsier_window_open(const tarsier::window::WindowOptions* options);
}
