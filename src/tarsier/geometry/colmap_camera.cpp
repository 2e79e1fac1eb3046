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

// Where the parameters go: f sets both focal lengths; the digits are places in distortion.
struct ModelOfColmap {
  std::string_view name;
  std::string_view parameters;
  Lens lens = Lens::kPinhole;
};
constexpr std::array<ModelOfColmap, 9> kModels{{{"SIMPLE_PINHOLE", "fuv"},
                                                {"PINHOLE", "xyuv"},
                                                {"SIMPLE_RADIAL", "fuv0"},
                                                {"RADIAL", "fuv01"},
                                                {"OPENCV", "xyuv0123"},
                                                {"FULL_OPENCV", "xyuv01234567", Lens::kRational},
                                                {"SIMPLE_RADIAL_FISHEYE", "fuv0", Lens::kFisheye},
                                                {"RADIAL_FISHEYE", "fuv01", Lens::kFisheye},
                                                {"OPENCV_FISHEYE", "xyuv0123", Lens::kFisheye}}};

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
  if (!id_value) throw fail(fmt::format("'{}' is no number of a camera", printable(id)));
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
      throw fail(fmt::format("'{}' is no width or height: 1..{}", printable(word), kMaxCameraSide));
    }
    *side = static_cast<int>(*value);
  }
  for (const char place : model->parameters) {
    const std::string_view word = next_word(rest);
    const auto value = to_number(word);
    if (!value) {
      throw fail(fmt::format("'{}' is no number; {} has {} parameters", printable(word),
                             model->name, model->parameters.size()));
    }
    if (place == 'f' || place == 'x') camera.fx = *value;
    if (place == 'f' || place == 'y') camera.fy = *value;
    if (place == 'u') camera.cx = *value - kColmapOffset;
    if (place == 'v') camera.cy = *value - kColmapOffset;
    if (place >= '0' && place <= '7')
      camera.distortion[static_cast<std::size_t>(place - '0')] = *value;
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

std::string colmap_camera_line(const ColmapCamera& given) {
  const Camera& camera = given.camera;
  const std::array<double, 8>& k = camera.distortion;
  std::vector<double> parameters{camera.fx, camera.fy, camera.cx + kColmapOffset,
                                 camera.cy + kColmapOffset};
  std::string_view name = "PINHOLE";
  if (camera.lens == Lens::kFisheye) {
    name = "OPENCV_FISHEYE";
    parameters.insert(parameters.end(), k.begin(), k.begin() + 4);
  } else if (camera.is_distorted()) {
    name = "OPENCV";
    parameters.insert(parameters.end(), k.begin(), k.begin() + 4);
    if (k[4] != 0 || camera.lens == Lens::kRational) {
      name = "FULL_OPENCV";
      parameters.insert(parameters.end(), k.begin() + 4, k.end());
    }
  }
  std::string line = fmt::format("{} {} {} {}", given.id, name, camera.width, camera.height);
  for (const double value : parameters) fmt::format_to(std::back_inserter(line), " {:.17g}", value);
  return line;
}

}  // namespace tarsier::geometry
