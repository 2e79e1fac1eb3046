// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/site/site.h"

#include "framework/cli.h"
#include "framework/run_session.h"
#include "verbs/plate/engine.h"
#include "verbs/plate/reports.h"
#include <string>
#include <vector>

// `plate read` with several cameras at once.
namespace tarsier::cli {

struct SiteFlags {
  plate::SiteOptions options;
  std::vector<std::string> regions;  // NAME=REGION
  std::vector<const Flag*> bound;    // the flags themselves
};

void add_site_flags(Command& verb, SiteFlags& flags);

// Throws UsageError if one of the flags was given.
void check_no_site_flags(const SiteFlags& flags);

struct NamedSource {
  std::string name;
  std::string source;
};

// The cameras of the inputs: all inputs if several are live, and inputs of the form NAME=SOURCE.
// Empty if the inputs are read one after the other. Throws UsageError if cameras and files are
// mixed, InputError as classify_source() does.
[[nodiscard]] std::vector<NamedSource> site_cameras(const RunFlags& run);

// Runs until it is stopped or all sources have ended.
[[nodiscard]] ExitStatus read_site(const std::vector<NamedSource>& cameras, const SiteFlags& flags,
                                   const RunFlags& run, const PlateFlags& plates,
                                   const plate::TrackerOptions& tracker,
                                   const ReportFlags& reporting, Context& context);

}  // namespace tarsier::cli
