// SPDX-License-Identifier: MIT
#include "verbs/sfm/scale_flags.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/length.h"
#include "tarsier/planar/markers/detector.h"
#include "tarsier/planar/markers/dictionary.h"

#include <cmath>

namespace tarsier::cli {
namespace {

sfm::FindMarkers finder_of(const std::string& family) {
  const planar::markers::Dictionary& dictionary = planar::markers::find_dictionary(family);
  return [&dictionary](const cv::Mat& gray) {
    planar::markers::DetectWorkspace workspace;
    std::vector<sfm::SeenMarker> seen;
    for (const auto& marker : planar::markers::detect_markers(gray, dictionary, {}, workspace))
      seen.push_back({marker.id, marker.corners});
    return seen;
  };
}

}  // namespace

void add_scale_flags(Command& verb, ScaleFlags& flags, std::string_view group) {
  const auto out = [&](Flag& flag) -> Flag& { return flag.group(std::string(group)); };
  out(verb.add_option("--distance", flags.distance,
                      "known distance between two cameras, in any unit; sets the scale [none]"));
  Flag& between =
      out(verb.add_option("--distance-between", flags.distance_between, "names of these two images")
              .expected(2));
  Flag& size =
      out(verb.add_option(
              "--marker-size", flags.marker_size,
              "side of the black frame of markers in the scene, 50mm; the result is in metres"))
          .excludes(between);
  out(verb.add_option("--marker-family", flags.marker_family,
                      "marker family, as for `ar markers --family`")
          .show_default())
      .needs(size);
}

void set_scale(const ScaleFlags& flags, sfm::PlacementOptions& options) {
  if (!flags.marker_size.empty()) {
    options.markers = sfm::KnownMarkers{parse_length(flags.marker_size, "--marker-size"),
                                        finder_of(flags.marker_family)};
    options.markers->check();
  }
  if (flags.distance_between.empty()) {
    if (flags.distance != 0) throw UsageError("--distance needs --distance-between");
    return;
  }
  if (!(flags.distance > 0 && std::isfinite(flags.distance)))
    throw UsageError("--distance-between needs --distance, above 0");
  if (flags.distance_between[0] == flags.distance_between[1])
    throw UsageError("--distance-between: expected the names of two images");
  options.distance =
      sfm::KnownDistance{flags.distance_between[0], flags.distance_between[1], flags.distance};
}

}  // namespace tarsier::cli
