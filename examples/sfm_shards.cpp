// SPDX-License-Identifier: MIT
// sfm_shards WORK MODEL INPUT..: a reconstruction in two shards, which could be two programs.
//   sfm_shards work model images/  or  drawn  (six images of a synthetic scene)
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/pipelines/inputs.h"
#include "tarsier/sfm/pipelines/sharded_reconstructor.h"
#include "tarsier/synth/sfm_scene.h"

#include <cstdio>
#include <exception>
#include <string>
#include <vector>

int main(int argc, char** argv) try {
  if (argc < 4) {
    std::fprintf(stderr, "usage: sfm_shards WORK MODEL INPUT..\n");
    return 2;
  }
  std::vector<std::string> inputs(argv + 3, argv + argc);
  if (inputs.front() == "drawn") {
    inputs.clear();
    const tarsier::synth::SfmScene scene({.size = {240, 180}, .images = 6});
    for (int i = 0; i < scene.count(); ++i)
      tarsier::write_image(inputs.emplace_back("shard-" + std::to_string(i) + ".png"),
                           scene.render(i));
  }
  tarsier::NoProgress progress;
  const auto images = tarsier::sfm::find_inputs(inputs, {}, "", progress, {});
  tarsier::sfm::write_plan(argv[1], images, {}, 2, progress, {});
  const tarsier::sfm::ShardedReconstructor sharded(argv[1]);
  for (const int shard : {1, 2}) sharded.find_features(shard, progress, {});
  for (const int shard : {1, 2}) sharded.match(shard, progress, {});
  tarsier::sfm::ReconstructorOptions options;
  options.folder = argv[2];
  const auto result = sharded.map(options, progress, {});
  std::printf("%zu points\n", result.models().at(0).points.size());
} catch (const std::exception& error) {
  std::fprintf(stderr, "sfm_shards: %s\n", error.what());
  return 1;
}
