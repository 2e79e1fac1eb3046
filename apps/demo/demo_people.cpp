// SPDX-License-Identifier: MIT
#include "tarsier/core/stop.h"
#include "tarsier/image/draw/tile.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "demo.h"
#include "verbs/people/engine.h"
#include "verbs/people/images.h"
#include "verbs/program/sample_images.h"
#include <filesystem>

namespace tarsier::cli {
void demo_people(Context& context, DemoPage& page) {
  page.begin_area("Face recognition",
                  "A face is detected, aligned by its eyes, and normalised for illumination. It is "
                  "then compared with the enrolled people; a face that matches nobody is unknown. "
                  "No data leave this machine, and each person can be deleted permanently.");
  page.command(
      fmt::format("tarsier people show --stages {} -o stages.png", sample_image("messi5.jpg")));
  std::vector<DemoImage> shown;
  face::people::FaceReader reader = make_face_reader({});
  for (const char* name : {"messi5.jpg"}) {
    throw_if_stopped(context.stop);
    const std::filesystem::path path = sample_image(name);
    if (!std::filesystem::exists(path)) continue;
    const NamedImages stages = face_stages(reader, read_gray_image(path.string()));
    if (stages.images.empty()) continue;
    shown.push_back(page.image("people-" + path.stem().string(),
                               image::draw::tile(stages.images, stages.names, {960, 560}),
                               fmt::format("{}: stages of preprocessing", name)));
  }
  if (shown.empty()) {
    page.note(
        "No images: the package opencv-doc is not installed. Install it and run the demo again.");
  } else {
    page.grid(shown);
  }
}

}  // namespace tarsier::cli
