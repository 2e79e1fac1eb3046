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
  page.begin_area("Who is it?",
                  "A face is found, its eyes are put at fixed places, and the light is taken out; "
                  "what is left is compared with the people who were enrolled, or is of nobody: "
                  "unknown. Nothing leaves this machine, and everyone can be forgotten for good.");
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
                               fmt::format("{}: the stages of preparation", name)));
  }
  if (shown.empty()) {
    page.note("The package opencv-doc is not installed; its images would be here.");
  } else {
    page.grid(shown);
  }
}

}  // namespace tarsier::cli
