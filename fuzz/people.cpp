// SPDX-License-Identifier: MIT
// Recognisers, lists of faces and galleries.
#include "tarsier/core/errors.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/onnx/network_file.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/cell_index.h"
#include "tarsier/face/recognition/deep.h"
#include "tarsier/face/recognition/evaluation.h"
#include "tarsier/face/recognition/recognizer.h"
#include "tarsier/media/sha256.h"

#include <opencv2/core.hpp>

#include "fuzz.h"
#include <cstring>
#include <filesystem>
#include <fstream>

namespace tarsier::fuzz {

using namespace tarsier::face::recognition;

TARSIER_FUZZ_TARGET(recognizer, kJson) {
  const face::recognition::Recognizer model = read_recognizer(file_of(input, "model.json"));
  model.check();
  if (model.templates.size() > 1'000'000) return;
  if (model.options.algorithm == Algorithm::kDeep) return;  // its network is not in the file
  (void)identify(model, cv::Mat(16, 12, CV_8UC1, cv::Scalar(7)));
  if (model.calibration) (void)model.calibration->threshold(0.01, 3);
}

TARSIER_FUZZ_TARGET(background, kJson) { read_background(file_of(input, "model.json")).check(); }

TARSIER_FUZZ_TARGET(face_embedding, kJson) {
  (void)read_deep_network(file_of(input, "face-embedding.json"));
}

// Fuzzes the manifest; its shard is 4096 zeros.
TARSIER_FUZZ_TARGET(weights_manifest, kJson) {
  const std::string manifest = file_of(input, "manifest.json");
  for (const std::string& name : shards_of_manifest(manifest)) {
    if (name == "manifest.json") return;
    std::ofstream(std::filesystem::path(manifest).parent_path() / name) << std::string(4096, '\0');
  }
  const DeepWeights weights = read_weights_manifest(manifest);
  try {
    (void)build_deep_network(weights, manifest);
  } catch (const Error&) {  // valid tensors need not form a network
  }
}

TARSIER_FUZZ_TARGET(onnx_network, kBytes) {
  const face::onnx::NetworkFile network =
      face::onnx::parse_network(std::string(text_of(input)), "network.onnx");
  expect(network.nodes > 0 && network.parameters >= 0, "a network without layers");
  for (const face::onnx::TensorInfo& form : network.inputs)
    for (const std::int64_t side : form.shape) expect(side == -1 || side > 0, "a side of an input");
}

TARSIER_FUZZ_TARGET(onnx_input_form, kBytes) {
  const face::onnx::InputFormat format =
      face::onnx::parse_input_format(text_of(input), "network.txt");
  expect(format.scale > 0 && (format.mean.size() == 1 || format.mean.size() == 3), "an input form");
  expect((format.width == 0) == (format.height == 0) && format.width <= 2048, "a size");
}

TARSIER_FUZZ_TARGET(face_list, kBytes) { (void)read_face_list(file_of(input, "faces.lst")); }

// An index as it is, and with the checksum of its head corrected, so that the rest is parsed, too.
TARSIER_FUZZ_TARGET(face_index, kBytes) {
  constexpr std::size_t kDigits = 8;  // their offset, after the mark
  constexpr std::size_t kHead = kDigits + 64;
  const auto read = [](const std::string& path) {
    const CellIndex index(path);
    expect(index.templates() > 0 && index.cells() > 0 && index.dimension() > 0, "an empty index");
    const std::vector<float> probe(static_cast<std::size_t>(index.dimension()), 0.25F);
    expect(index.search(probe, 3, 5).size() <= 5, "more than was asked for");
    NoProgress quiet;
    index.each_cell([](std::span<const std::int64_t>) {}, quiet, {});
  };
  try {
    read(file_of(input, "people.db.index"));
    return;
  } catch (const InputError&) {
  }
  std::string bytes(text_of(input));
  if (bytes.size() < kHead + 48) return;
  std::int64_t learned_from = 0;
  std::int32_t dimension = 0;
  std::int32_t cells = 0;
  std::memcpy(&learned_from, bytes.data() + kHead + 32, sizeof learned_from);
  std::memcpy(&dimension, bytes.data() + kHead + 40, sizeof dimension);
  std::memcpy(&cells, bytes.data() + kHead + 44, sizeof cells);
  if (learned_from < 0 || learned_from > 1000 || dimension <= 0 || dimension > 64 || cells <= 0 ||
      cells > 64)
    return;
  const std::size_t size =
      48 + static_cast<std::size_t>(cells) * (4 * static_cast<std::size_t>(dimension) + 24) +
      8 * static_cast<std::size_t>(learned_from);
  if (bytes.size() < kHead + size) return;
  Sha256 sha;
  sha.add(std::string_view(bytes).substr(kHead, size));
  bytes.replace(kDigits, 64, sha.hex());
  read(file_of(bytes, "people.db.index"));
}

TARSIER_FUZZ_TARGET(gallery, kBytes) {
  face::people::Gallery gallery(file_of(input, "people.db"), DatabaseAccess::kRead, 0);
  (void)gallery.people();
  (void)gallery.find("Ada");
  (void)gallery.sightings(100);
  (void)gallery.algorithm();
  if (const auto model = gallery.model()) {
    try {
      (void)recognizer_from_text(model->body, "people.db");
    } catch (const Error&) {
    }
  }
  (void)gallery.faces();
}

}  // namespace tarsier::fuzz
