// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"
#include <array>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

// The command line of `tarsier demo`. It is declared in two programs: tarsier documents it and
// starts tarsier-demo, and tarsier-demo creates the page (apps/demo/).
namespace tarsier::cli {

// In the order of the page.
inline constexpr auto kDemoAreas =
    std::to_array<std::string_view>({"cartoon", "sfm", "plate", "landmarks", "aam", "pose",
                                     "people", "calibrate", "markers", "targets"});

struct DemoOptions {
  std::string output = "demo-out";  // folder of the page
  std::vector<std::string> only;    // subset of kDemoAreas; empty: all
};

using RunDemo = std::function<ExitStatus(const DemoOptions&, Context&)>;
void add_demo(Command& app, Context& context, const RunDemo& run);

}  // namespace tarsier::cli
