// SPDX-License-Identifier: MIT
#include "tarsier/geometry/colmap_camera.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"

#include <fmt/format.h>

#include <array>
#include <iterator>
#include <limits>
#include <vector>

namespace tarsier::geometry {
namespace {

// Target of each parameter: f sets both focal lengths; the digits are indices of distortion.
struct ModelOfColmap {
  std::string_view name;
  std::string_view parameters;
  int number = 0;  // in binary files
  Lens lens = Lens::kPinhole;
};
constexpr std::array<ModelOfColmap, 9> kModels{
    {{"SIMPLE_PINHOLE", "fuv", 0},
     {"PINHOLE", "xyuv", 1},
     {"SIMPLE_RADIAL", "fuv0", 2},
     {"RADIAL", "fuv01", 3},
     {"OPENCV", "xyuv0123", 4},
     {"FULL_OPENCV", "xyuv01234567", 6, Lens::kRational},
     {"SIMPLE_RADIAL_FISHEYE", "fuv0", 8, Lens::kFisheye},
     {"RADIAL_FISHEYE", "fuv01", 9, Lens::kFisheye},
     {"OPENCV_FISHEYE", "xyuv0123", 5, Lens::kFisheye}}};

const ModelOfColmap* model_numbered(int number) {
  for (const ModelOfColmap& model : kModels)
    if (model.number == number) return &model;
  return nullptr;
}

}  // namespace

ColmapCamera parse_colmap_camera(std::string_view text, const std::string& path,
                                 std::int64_t line) {
  const auto fail = [&](const std::string& reason) {
    return InputError(path, fmt::format("line {}: {}", line, reason));
  };
  std::string_view rest = text;
  ColmapCamera result;
  const std::string_view id = next_word(rest);
  const auto id_value = to_integer(id, 0, std::numeric_limits<std::uint32_t>::max());
  if (!id_value) throw fail(fmt::format("'{}' is not the number of a camera", printable(id)));
  result.id = *id_value;

  const std::string_view name = next_word(rest);
  const ModelOfColmap* model = nullptr;
  for (const ModelOfColmap& known : kModels) {
    if (known.name == name) model = &known;
  }
  if (model == nullptr) {
    throw fail(
        fmt::format("camera model '{}' is none of SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, "
                    "RADIAL, OPENCV, FULL_OPENCV, SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, "
                    "OPENCV_FISHEYE",
                    printable(name)));
  }
  Camera& camera = result.camera;
  for (int* side : {&camera.width, &camera.height}) {
    const std::string_view word = next_word(rest);
    const auto value = to_integer(word, 1, kMaxCameraSide);
    if (!value) {
      throw fail(fmt::format("'{}' is not a width or height: expected 1..{}", printable(word),
                             kMaxCameraSide));
    }
    *side = static_cast<int>(*value);
  }
  for (const char symbol : model->parameters) {
    const std::string_view word = next_word(rest);
    const auto value = to_number(word);
    if (!value) {
      throw fail(fmt::format("'{}' is not a number; {} has {} parameters", printable(word),
                             model->name, model->parameters.size()));
    }
    if (symbol == 'f' || symbol == 'x') camera.fx = *value;
    if (symbol == 'f' || symbol == 'y') camera.fy = *value;
    if (symbol == 'u') camera.cx = *value - kColmapOffset;
    if (symbol == 'v') camera.cy = *value - kColmapOffset;
    if (symbol >= '0' && symbol <= '7')
      camera.distortion[static_cast<std::size_t>(symbol - '0')] = *value;
  }
  if (!trimmed(rest).empty())
    throw fail(fmt::format("{} has {} parameters", model->name, model->parameters.size()));
  camera.lens = model->lens;
  const auto& k = camera.distortion;
  if (camera.lens == Lens::kRational && k[5] == 0 && k[6] == 0 && k[7] == 0)
    camera.lens = Lens::kPinhole;
  if (!(camera.fx > 0) || !(camera.fy > 0)) throw fail("the focal length is not positive");
  return result;
}

ColmapCameraNumbers numbers_of(const Camera& camera) {
  const std::array<double, 8>& k = camera.distortion;
  ColmapCameraNumbers numbers{
      1,
      camera.width,
      camera.height,
      {camera.fx, camera.fy, camera.cx + kColmapOffset, camera.cy + kColmapOffset}};
  std::vector<double>& parameters = numbers.parameters;
  if (camera.lens == Lens::kFisheye) {
    numbers.model = 5;
    parameters.insert(parameters.end(), k.begin(), k.begin() + 4);
  } else if (camera.is_distorted()) {
    numbers.model = 4;
    parameters.insert(parameters.end(), k.begin(), k.begin() + 4);
    if (k[4] != 0 || camera.lens == Lens::kRational) {
      numbers.model = 6;
      parameters.insert(parameters.end(), k.begin() + 4, k.end());
    }
  }
  return numbers;
}

int colmap_parameter_count(int model) {
  const ModelOfColmap* known = model_numbered(model);
  return known == nullptr ? 0 : static_cast<int>(known->parameters.size());
}

Camera camera_of(const ColmapCameraNumbers& numbers, const std::string& path, std::int64_t id) {
  const ModelOfColmap* model = model_numbered(numbers.model);
  if (model == nullptr)
    throw InputError(path,
                     fmt::format("camera {}: model number {} is not known", id, numbers.model));
  std::string line = fmt::format("{} {} {} {}", id, model->name, numbers.width, numbers.height);
  for (const double value : numbers.parameters)
    fmt::format_to(std::back_inserter(line), " {:.17g}", value);
  return parse_colmap_camera(line, path, id).camera;
}

std::string colmap_camera_line(const ColmapCamera& given) {
  const ColmapCameraNumbers numbers = numbers_of(given.camera);
  std::string line = fmt::format("{} {} {} {}", given.id, model_numbered(numbers.model)->name,
                                 numbers.width, numbers.height);
  for (const double value : numbers.parameters)
    fmt::format_to(std::back_inserter(line), " {:.17g}", value);
  return line;
}

}  // namespace tarsier::geometry
