// SPDX-License-Identifier: MIT
// ink IN OUT: an image as a pencil sketch, by the installed libraries.
#include "tarsier/cartoon/cartoonizer.h"
#include "tarsier/core/errors.h"
#include "tarsier/media/image_file.h"

#include <opencv2/core/mat.hpp>

#include <cstdio>
#include <exception>

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: ink IN OUT\n");
    return static_cast<int>(tarsier::ExitStatus::kUsage);
  }
  try {
    tarsier::cartoon::CartoonOptions options;
    options.mode = tarsier::cartoon::Mode::kSketch;
    tarsier::cartoon::CartoonState state;  // one for each stream of frames
    const cv::Mat photo = tarsier::read_image(argv[1]);
    tarsier::write_image(argv[2], tarsier::cartoon::cartoonize(photo, options, state));
    return 0;
  } catch (const tarsier::Error& error) {  // files: its status is that of the program `tarsier`
    std::fprintf(stderr, "ink: %s\n", error.what());
    return static_cast<int>(error.status());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "ink: %s\n", error.what());
    return static_cast<int>(tarsier::ExitStatus::kUsage);
  }
}
