// SPDX-License-Identifier: MIT
#include "framework/error_help.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/pipelines/template_error.h"

#include <array>
#include <string_view>
#include <utility>

namespace tarsier::cli {

namespace {

// The verb that lists the entries of a kind.
std::string listing_of(const MissingEntryError& error) {
  using Listing = std::pair<std::string_view, std::string_view>;
  constexpr auto kListings = std::to_array<Listing>({
      {"correction", ": `people log` lists them"},
      {"face", ": `people list --faces NAME` lists those of a person"},
      {"group", ": `people groups` lists them"},
      {"member of a group", ": `people groups --group GROUP` lists them"},
      {"person", ": `people list` lists them"},
      {"plate", ": `plate log --json` shows the ids"},
      {"sighting", ": `people list --sightings` lists them"},
  });
  for (const auto& [entry, listing] : kListings)
    if (error.entry() == entry) return std::string(listing);
  return {};
}

std::string remedy_of(face::TemplateProblem problem) {
  using face::TemplateProblem;
  switch (problem) {
    case TemplateProblem::kNotCalibrated:
      return ": train a background with `people train --learn-background LIST --embedding FILE -o "
             "B.json` and pass --background B.json";
    case TemplateProblem::kOtherNetwork:
      return ": recompute them with `people train --embedding FILE`";
    case TemplateProblem::kNetworkNotGiven:
      return ": pass that file with --embedding, or recompute them with `people train --template "
             "deep|classic`";
    case TemplateProblem::kNotDeep:
      return ": recompute them with `people train --template deep`";
    case TemplateProblem::kNotClassic:
      return ": recompute them with `people train --template classic`";
  }
  return {};
}

}  // namespace

std::string error_help(const std::exception& error) {
  if (const auto* missing = dynamic_cast<const MissingEntryError*>(&error))
    return listing_of(*missing);
  const auto* templates = dynamic_cast<const face::TemplateError*>(&error);
  return templates == nullptr ? std::string() : remedy_of(templates->problem());
}

}  // namespace tarsier::cli
