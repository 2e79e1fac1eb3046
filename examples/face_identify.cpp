// SPDX-License-Identifier: MIT
// face_identify GALLERY INPUT [NAME]: identifies the faces of INPUT in a gallery. With NAME, first
// enrols the largest face of the image INPUT under that name.
//   face_identify people.db me.jpg Me && face_identify people.db 0
#include "tarsier/core/errors.h"
#include "tarsier/face/pipelines/identifier.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/image_file.h"

#include <chrono>
#include <cstdio>
#include <exception>
#include <nlohmann/json.hpp>

namespace face = tarsier::face;

int main(int argc, char** argv) try {
  if (argc < 3) return std::fprintf(stderr, "usage: face_identify GALLERY INPUT [NAME]\n"), 2;
  const auto models = tarsier::ModelStore::find();
  if (argc > 3) {
    auto reader = face::FaceReaderModel::load(models).make_reader();
    tarsier::face::people::StoredFace stored;
    stored.crop = reader.read(tarsier::read_gray_image(argv[2])).at(0).crop;
    tarsier::face::people::Gallery(argv[1]).enroll(argv[3], "", stored);
  }
  face::IdentifierOptions options;
  options.gallery = argv[1];
  const auto identifier = face::Identifier::load(models, options);
  face::IdentifierState state = identifier.open();
  const auto source = tarsier::open_source(argv[2]);
  while (!source->ended()) {
    const auto frame = source->next(std::chrono::seconds(1), {});
    if (!frame) continue;
    std::printf("%s\n", to_json(identifier.process(*frame, state)).dump().c_str());
  }
  return 0;
} catch (const std::exception& error) {
  return std::fprintf(stderr, "face_identify: %s\n", error.what()), 1;
}
