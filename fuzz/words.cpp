// SPDX-License-Identifier: MIT
// Values on the command line. The first byte says which.
#include "tarsier/calibration/board.h"
#include "tarsier/core/length.h"
#include "tarsier/gallery/name.h"
#include "tarsier/geometry/camera_file.h"
#include "tarsier/plate_video/region.h"
#include "tarsier/plate_video/time_text.h"
#include "tarsier/sheet/sheet.h"
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
      calibration::parse_board(text, 0.025).check();
      break;
    case 2:
      (void)sheet::parse_paper(text);
      break;
    case 3:
      (void)sheet::parse_ids(text, "6x6_250");
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
      people::check_name(text);
      break;
    case 9:
      people::check_note(text);
      break;
    default:
      (void)open_synth_source(text);
  }
}

}  // namespace tarsier::fuzz
