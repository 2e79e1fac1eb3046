// SPDX-License-Identifier: MIT
// Values on the command line. The first byte selects the kind.
#include "tarsier/core/length.h"
#include "tarsier/face/people/name.h"
#include "tarsier/geometry/camera_file.h"
#include "tarsier/planar/calibration/board.h"
#include "tarsier/planar/sheets/sheet.h"
#include "tarsier/plate/tracking/region.h"
#include "tarsier/plate/tracking/time_text.h"
#include "tarsier/synth/sources.h"

#include "fuzz.h"
#include <chrono>

namespace tarsier::fuzz {

TARSIER_FUZZ_TARGET(words, kBytes) {
  if (input.empty()) return;
  const std::string text(text_of(input.subspan(1)));
  const plate::Moment now{std::chrono::hours(24 * 365 * 50)};
  switch (input.front() % 11) {
    case 0:
      expect(parse_length(text, "--size") > 0, "a length that is none");
      break;
    case 1:
      planar::calibration::parse_board(text, 0.025).check();
      break;
    case 2:
      (void)planar::sheets::parse_paper(text);
      break;
    case 3:
      (void)planar::sheets::parse_ids(text, "6x6_250");
      break;
    case 4:
      (void)plate::moment_text(plate::parse_moment(text, now, false, "--since"));
      break;
    case 5:
      (void)plate::parse_duration(text, "--for");
      break;
    case 6: {
      const plate::Region region = plate::parse_region(text);
      (void)region.contains({0.5, 0.5}, {640, 480});
      (void)region.outline({640, 480});
      break;
    }
    case 7:
      (void)geometry::parse_camera(text);
      break;
    case 8:
      face::people::check_name(text);
      break;
    case 9:
      face::people::check_note(text);
      break;
    default:
      (void)synth::open_synth_source(text);
  }
}

}  // namespace tarsier::fuzz
