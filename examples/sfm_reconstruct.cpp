// SPDX-License-Identifier: MIT
// sfm_reconstruct FOLDER INPUT..: writes the poses and point cloud of images or a video to FOLDER.
//   sfm_reconstruct model images/
//   sfm_reconstruct model walk.mp4
//   sfm_reconstruct model drawn    (six images of a synthetic scene)
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/pipelines/reconstructor.h"
#include "tarsier/synth/sfm_scene.h"

#include <cstdio>
#include <exception>
#include <string>
#include <vector>

int main(int argc, char** argv) try {
  if (argc < 3) {
    std::fprintf(stderr, "usage: sfm_reconstruct FOLDER INPUT..\n");
    return 2;
  }
  std::vector<std::string> inputs(argv + 2, argv + argc);
  tarsier::sfm::ReconstructorOptions options;
  options.folder = argv[1];
  if (inputs.front() == "drawn") {
    inputs.clear();
    const tarsier::synth::SfmScene scene({.size = {240, 180}, .images = 6});
    for (int i = 0; i < scene.count(); ++i) {
      inputs.push_back("drawn-" + std::to_string(i) + ".png");
      tarsier::write_image(inputs.back(), scene.render(i));
    }
  }
  tarsier::NoProgress progress;
  const auto result = tarsier::sfm::Reconstructor(options).run(inputs, progress, {});
  for (const auto& image : result.models().at(0).images)
    if (image.registered)
      std::printf("%s at %.2f %.2f %.2f\n", image.name.c_str(), image.pose.center()[0],
                  image.pose.center()[1], image.pose.center()[2]);
} catch (const std::exception& error) {
  std::fprintf(stderr, "sfm_reconstruct: %s\n", error.what());
  return 1;
}
