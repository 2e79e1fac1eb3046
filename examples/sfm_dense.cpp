// SPDX-License-Identifier: MIT
// sfm_dense FOLDER MODEL IMAGES: writes depth maps and a dense cloud of a model to FOLDER.
//   sfm_dense dense model photos
//   sfm_dense dense drawn       (four images of a synthetic scene)
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/dense/dense_reconstructor.h"
#include "tarsier/sfm/pipelines/reconstructor.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/synth/sfm_scene.h"

#include <cstdio>
#include <exception>

int main(int argc, char** argv) try {
  if (argc < 3) {
    std::fprintf(stderr, "usage: sfm_dense FOLDER MODEL IMAGES\n");
    return 2;
  }
  tarsier::NoProgress progress;
  std::string model = argv[2];
  if (model == "drawn") {
    const tarsier::synth::SfmScene scene({.size = {240, 180}, .images = 4});
    std::vector<std::string> images;
    for (int i = 0; i < scene.count(); ++i) {
      images.push_back("drawn-" + std::to_string(i) + ".png");
      tarsier::write_image(images.back(), scene.render(i));
    }
    tarsier::sfm::ReconstructorOptions options;
    options.folder = model = "drawn-model";
    (void)tarsier::sfm::Reconstructor(options).run(images, progress, {});
  }
  const std::string folder = argc > 3 ? std::string(argv[3]) + "/" : "";
  const auto path_of = [&](const std::string& name) { return folder + name; };
  const tarsier::sfm::DenseReconstructor dense(dense_options(tarsier::sfm::DenseQuality::kNormal));
  const auto result = dense.run({tarsier::sfm::read_colmap(model), path_of, argv[1]}, progress, {});
  std::printf("%s: %lld points\n", result.cloud.c_str(), static_cast<long long>(result.points));
} catch (const std::exception& error) {
  std::fprintf(stderr, "sfm_dense: %s\n", error.what());
  return 1;
}
