// SPDX-License-Identifier: MIT
// ink IN OUT: converts an image to a pencil sketch with the installed libraries.
#include "tarsier/cartoon/cartoonizer.h"
#include "tarsier/core/errors.h"
#include "tarsier/media/image_file.h"

#include <opencv2/core/mat.hpp>

#include <cstdio>
#include <exception>

namespace {
constexpr int kFailed = 1;
constexpr int kUsage = 2;
constexpr int kBadInput = 3;
}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: ink IN OUT\n");
    return kUsage;
  }
  try {
    tarsier::cartoon::CartoonOptions options;
    options.mode = tarsier::cartoon::Mode::kSketch;
    const auto cartoonizer = tarsier::cartoon::Cartoonizer::load({}, options);
    tarsier::cartoon::CartoonizerState state;  // one per stream of frames
    tarsier::Frame frame;
    frame.image = tarsier::read_image(argv[1]);
    tarsier::write_image(argv[2], cartoonizer.process(frame, state).image);
    return 0;
  } catch (const tarsier::Error& error) {
    std::fprintf(stderr, "ink: %s\n", error.what());
    return error.kind() == tarsier::ErrorKind::kInput ? kBadInput : kFailed;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "ink: %s\n", error.what());
    return kFailed;
  }
}
