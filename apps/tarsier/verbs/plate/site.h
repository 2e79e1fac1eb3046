// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/site/site.h"

#include "framework/cli.h"
#include "framework/run_session.h"
#include "verbs/plate/engine.h"
#include "verbs/plate/reports.h"
#include <string>
#include <vector>

// `plate read` of several cameras at once.
namespace tarsier::cli {

struct SiteFlags {
  plate::SiteOptions options;
  std::vector<std::string> regions;  // NAME=REGION
};

void add_site_flags(Command& verb, SiteFlags& flags);

struct NamedSource {
  std::string name;
  std::string source;
};

// The cameras that the inputs name: all of several inputs that are live, and those that are written
// NAME=SOURCE. Empty where the inputs are read one after the other. Throws UsageError where cameras
// and files are mixed, InputError as classify_source().
[[nodiscard]] std::vector<NamedSource> site_cameras(const RunFlags& run);

// Until it is stopped, or all sources have ended.
[[nodiscard]] ExitStatus read_site(const std::vector<NamedSource>& cameras, const SiteFlags& flags,
                                   const RunFlags& run, const PlateFlags& plates,
                                   const plate::TrackerOptions& tracker,
                                   const ReportFlags& reporting, Context& context);

}  // namespace tarsier::cli
