// SPDX-License-Identifier: MIT
#include "framework/areas.h"

int main(int argc, char** argv) {
  namespace cli = tarsier::cli;
  return cli::run_main({cli::add_areas, cli::main_help()}, argc, argv);
}
