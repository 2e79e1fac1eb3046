// SPDX-License-Identifier: MIT
// face_identify GALLERY INPUT [NAME]: names the faces of images, videos or a camera after the
// people of a gallery, a JSON line for each frame. With NAME the largest face of the image INPUT is
// enrolled under it first.
//   face_identify people.db me.jpg Me && face_identify people.db 0
#include "tarsier/core/errors.h"
#include "tarsier/face_pipelines/identifier.h"
#include "tarsier/io/frame_source.h"
#include "tarsier/io/image_file.h"

#include <chrono>
#include <cstdio>
#include <exception>
#include <nlohmann/json.hpp>

using namespace tarsier;

int main(int argc, char** argv) try {
  if (argc < 3) return std::fprintf(stderr, "usage: face_identify GALLERY INPUT [NAME]\n"), 2;
  const ModelStore models = ModelStore::find();
  if (argc > 3) {
    people::FaceReader reader = face::FaceReaderModel::load(models).make_reader();
    people::StoredFace stored;
    stored.crop = reader.read(read_gray_image(argv[2])).at(0).crop;
    people::Gallery(argv[1]).enroll(argv[3], "", stored);
  }
  const auto identifier = face::Identifier::load(models, {.gallery = argv[1]});
  face::IdentifierState state = identifier.open();
  const auto source = open_source(argv[2]);
  while (!source->ended()) {
    const auto frame = source->next(std::chrono::seconds(1), {});
    if (!frame) continue;
    nlohmann::ordered_json line{{"image", frame->name}};
    line.update(to_json(identifier.process(*frame, state)));
    std::printf("%s\n", line.dump().c_str());
  }
  return 0;
} catch (const std::exception& error) {
  return std::fprintf(stderr, "face_identify: %s\n", error.what()), 1;
}
