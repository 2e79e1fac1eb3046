// SPDX-License-Identifier: MIT
#include "cli.h"

int main(int argc, char** argv) { return tarsier::cli::run_program(argc, argv); }
