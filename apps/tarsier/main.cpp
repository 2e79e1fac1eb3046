// SPDX-License-Identifier: MIT
#include "framework/areas.h"

int main(int argc, char** argv) {
  namespace cli = tarsier::cli;
  return cli::run_program({cli::add_areas, cli::main_help()}, cli::words_of(argc, argv));
}
