// SPDX-License-Identifier: MIT
#include "tarsier/geometry/camera_file.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/words.h"
#include "tarsier/geometry/colmap_camera.h"
#include "tarsier/geometry/opencv_storage.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <set>
#include <span>
#include <string_view>
#include <vector>

namespace tarsier::geometry {
namespace {

constexpr std::int64_t kMaxFileBytes = 1'000'000;

// The fault of a camera whose size may be unknown; empty if there is none.
std::string camera_error(const Camera& camera) {
  const auto is_invalid_side = [](int side) { return side < 0 || side > kMaxCameraSide; };
  if (is_invalid_side(camera.width) || is_invalid_side(camera.height) ||
      (camera.width == 0) != (camera.height == 0)) {
    return fmt::format("the size {}x{} px is none", camera.width, camera.height);
  }
  if (!(camera.fx > 0 && std::isfinite(camera.fx) && camera.fy > 0 && std::isfinite(camera.fy)))
    return fmt::format("the focal lengths {}, {} are not positive", camera.fx, camera.fy);
  if (!std::isfinite(camera.cx) || !std::isfinite(camera.cy))
    return "the principal point is not finite";
  if (!std::all_of(camera.distortion.begin(), camera.distortion.end(),
                   [](double k) { return std::isfinite(k); })) {
    return "the distortion is not finite";
  }
  const auto k = camera.coefficients();
  if (std::any_of(camera.distortion.begin() + static_cast<std::ptrdiff_t>(k.size()),
                  camera.distortion.end(), [](double v) { return v != 0; })) {
    return fmt::format("a {} lens has {} numbers", name_of(camera.lens), k.size());
  }
  if (!(camera.rms >= 0 && std::isfinite(camera.rms)))
    return fmt::format("the rms {} is none", camera.rms);
  return {};
}

// Focal lengths and principal point of a row-major matrix.
Camera camera_of_matrix(const std::vector<double>& m, const std::string& path) {
  if (m.size() != 9) {
    throw InputError(path, fmt::format("a calibration matrix has 9 numbers, not {}", m.size()));
  }
  if (std::abs(m[1]) > 1e-9 * std::abs(m[0]))
    throw InputError(path, fmt::format("the calibration matrix has skew ({}), not modelled", m[1]));
  if (m[3] != 0 || m[6] != 0 || m[7] != 0 || m[8] != 1)
    throw InputError(path, "is not a calibration matrix: expected [fx 0 cx; 0 fy cy; 0 0 1]");
  Camera camera;
  camera.fx = m[0];
  camera.cx = m[2];
  camera.fy = m[4];
  camera.cy = m[5];
  return camera;
}

class OwnYamlParser {
 public:
  explicit OwnYamlParser(const std::string& path) : path_(path) {}

  Camera parse(std::string_view text) {
    while (!text.empty()) {
      ++line_;
      parse_line(next_line(text));
    }
    for (const char* key : {"model", "fx", "fy", "cx", "cy"}) {
      if (!seen_.contains(key)) throw InputError(path_, fmt::format("'{}:' is missing", key));
    }
    set_distortion();
    return camera_;
  }

 private:
  [[noreturn]] void fail(const std::string& reason) const {
    throw InputError(path_, fmt::format("line {}: {}", line_, reason));
  }

  void parse_line(std::string_view line) {
    for (std::size_t k = 0; k < line.size(); ++k) {
      if (line[k] == '#' && (k == 0 || is_blank(line[k - 1]))) line = line.substr(0, k);
    }
    line = trimmed(line);
    if (line.empty() || line == "---" || line == "...") return;
    const std::size_t colon = line.find(':');
    if (colon == std::string_view::npos) fail("'key: value' is expected");
    const std::string key(trimmed(line.substr(0, colon)));
    const std::string_view value = trimmed(line.substr(colon + 1));
    if (!seen_.insert(key).second) fail(fmt::format("a second '{}:'", printable(key)));
    if (key == "model") {
      const auto lens = lens_named(value);
      if (!lens)
        fail(fmt::format("model '{}' is none of pinhole, rational, fisheye", printable(value)));
      camera_.lens = *lens;
    } else if (key == "width") {
      camera_.width = side(value);
    } else if (key == "height") {
      camera_.height = side(value);
    } else if (key == "distortion") {
      parse_distortion(value);
    } else if (double* target = number_target(key)) {
      *target = number(value);
    } else {
      fail(fmt::format("'{}' is none of model, width, height, fx, fy, cx, cy, distortion, rms",
                       printable(key)));
    }
  }

  double* number_target(std::string_view key) {
    if (key == "fx") return &camera_.fx;
    if (key == "fy") return &camera_.fy;
    if (key == "cx") return &camera_.cx;
    if (key == "cy") return &camera_.cy;
    if (key == "rms") return &camera_.rms;
    return nullptr;
  }

  [[nodiscard]] int side(std::string_view word) const {
    const auto value = to_integer(word, 0, kMaxCameraSide);
    if (!value)
      fail(fmt::format("'{}' is not a size: expected 0..{} px", printable(word), kMaxCameraSide));
    return static_cast<int>(*value);
  }

  [[nodiscard]] double number(std::string_view word) const {
    const auto value = to_number(word);
    if (!value) fail(fmt::format("'{}' is not a finite number", printable(word)));
    return *value;
  }

  void parse_distortion(std::string_view list) {
    if (list.size() < 2 || list.front() != '[' || list.back() != ']')
      fail("distortion: [k1, k2, p1, p2, k3] is expected");
    list = list.substr(1, list.size() - 2);
    distortion_line_ = line_;
    while (true) {
      const std::size_t comma = list.find(',');
      if (distortion_.size() == camera_.distortion.size()) fail("distortion: too many numbers");
      distortion_.push_back(number(trimmed(list.substr(0, comma))));
      if (comma == std::string_view::npos) return;
      list.remove_prefix(comma + 1);
    }
  }

  // Called when the model is known, which may come later in the file.
  void set_distortion() {
    if (distortion_line_ == 0) return;
    line_ = distortion_line_;
    const std::size_t expected = camera_.coefficients().size();
    if (distortion_.size() != expected) {
      fail(fmt::format("distortion: {} numbers, a {} lens has {}", distortion_.size(),
                       name_of(camera_.lens), expected));
    }
    std::copy(distortion_.begin(), distortion_.end(), camera_.distortion.begin());
  }

  const std::string& path_;
  Camera camera_;
  std::set<std::string> seen_;
  std::vector<double> distortion_;
  std::int64_t distortion_line_ = 0;
  std::int64_t line_ = 0;
};

const StoredEntry* first_of(const StoredEntries& entries, std::initializer_list<const char*> keys) {
  for (const char* key : keys) {
    if (const auto found = entries.find(key); found != entries.end()) return &found->second;
  }
  return nullptr;
}

double number_in(std::string_view text, std::string_view what, const std::string& path) {
  const auto value = to_number(trimmed(text));
  if (!value) throw InputError(path, fmt::format("{} is not a finite number", what));
  return *value;
}

// The numbers of a matrix or a list.
std::vector<double> numbers_in(const StoredEntry& entry, std::string_view what,
                               const std::string& path) {
  const auto data = entry.parts.find("data");
  const bool is_matrix = data != entry.parts.end();
  const std::string& text = is_matrix ? data->second : entry.text;
  constexpr std::string_view kSeparators = " \t\r\n,[]";
  std::vector<double> numbers;
  for (std::size_t start = text.find_first_not_of(kSeparators); start != std::string::npos;) {
    const std::size_t end = std::min(text.find_first_of(kSeparators, start), text.size());
    numbers.push_back(number_in(std::string_view(text).substr(start, end - start),
                                fmt::format("a number of {}", what), path));
    start = text.find_first_not_of(kSeparators, end);
  }
  if (is_matrix) {
    double size = 1;
    for (const char* side : {"rows", "cols"}) {
      const auto found = entry.parts.find(side);
      size *= number_in(found == entry.parts.end() ? "" : found->second,
                        fmt::format("{} of {}", side, what), path);
    }
    if (size != static_cast<double>(numbers.size()))
      throw InputError(path,
                       fmt::format("{} has {} numbers, not rows x cols", what, numbers.size()));
  }
  return numbers;
}

void set_opencv_distortion(Camera& camera, const StoredEntry& entry, const std::string& path) {
  std::vector<double> k = numbers_in(entry, "the distortion", path);
  const bool is_fisheye = camera.lens == Lens::kFisheye;
  if (!k.empty() && k.size() < 4) {
    throw InputError(path, fmt::format("the distortion has {} numbers, not {}", k.size(),
                                       is_fisheye ? "4" : "4, 5 or 8"));
  }
  const std::size_t max_count = is_fisheye ? 4 : 8;
  for (std::size_t i = max_count; i < k.size(); ++i) {
    if (k[i] != 0) {
      throw InputError(path, is_fisheye ? "has more than the four numbers k1 k2 k3 k4 of a fisheye"
                                        : "has more than the eight distortion numbers k1 k2 p1 p2 "
                                          "k3 k4 k5 k6");
    }
  }
  k.resize(max_count);
  std::copy(k.begin(), k.end(), camera.distortion.begin());
  const auto& d = camera.distortion;
  if (!is_fisheye && (d[5] != 0 || d[6] != 0 || d[7] != 0)) camera.lens = Lens::kRational;
}

bool is_marked_fisheye(const StoredEntries& entries, const std::string& path) {
  if (const StoredEntry* flag = first_of(entries, {"fisheye_model"}))
    return number_in(flag->text, "fisheye_model", path) != 0;
  const StoredEntry* name = first_of(entries, {"distortion_model"});
  return name != nullptr && (name->text.find("equidistant") != std::string::npos ||
                             name->text.find("fisheye") != std::string::npos);
}

Camera read_opencv(std::string_view text, const std::string& path,
                   const CameraFileOptions& options) {
  const StoredEntries entries = parse_opencv_storage(text, path);
  const StoredEntry* matrix =
      first_of(entries, {"camera_matrix", "Camera_Matrix", "cameraMatrix", "K"});
  if (matrix == nullptr)
    throw InputError(path, "has none of camera_matrix, Camera_Matrix, cameraMatrix, K");
  Camera camera = camera_of_matrix(numbers_in(*matrix, "the camera matrix", path), path);
  if (options.opencv_is_fisheye || is_marked_fisheye(entries, path)) camera.lens = Lens::kFisheye;
  if (const StoredEntry* distortion = first_of(
          entries,
          {"distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist_coeffs"})) {
    set_opencv_distortion(camera, *distortion, path);
  }
  const auto side = [&](std::initializer_list<const char*> keys, std::string_view what) {
    const StoredEntry* entry = first_of(entries, keys);
    if (entry == nullptr) return 0;
    const double value = number_in(entry->text, what, path);
    if (!(value >= 1 && value <= kMaxCameraSide) || value != std::floor(value))
      throw InputError(path, fmt::format("{} {} is none", what, value));
    return static_cast<int>(value);
  };
  camera.width = side({"image_width", "image_Width", "Image_Width"}, "the width");
  camera.height = side({"image_height", "image_Height", "Image_Height"}, "the height");
  if (const StoredEntry* rms =
          first_of(entries, {"avg_reprojection_error", "Avg_Reprojection_Error"})) {
    camera.rms = number_in(rms->text, "the reprojection error", path);
  }
  return camera;
}

Camera read_colmap_camera(std::string_view text, const std::string& path) {
  std::optional<Camera> camera;
  for (std::int64_t line = 1; !text.empty(); ++line) {
    const std::string_view content = trimmed(next_line(text));
    if (content.empty() || content.front() == '#') continue;
    if (camera) throw InputError(path, fmt::format("line {}: one camera is expected", line));
    camera = parse_colmap_camera(content, path, line).camera;
  }
  return camera.value();
}

Camera read_matrix(std::string_view text, const std::string& path) {
  std::vector<double> numbers;
  for (std::int64_t line = 1; !text.empty(); ++line) {
    std::string_view rest = trimmed(next_line(text));
    if (rest.empty() || rest.front() == '#') continue;
    for (std::string_view word = next_word(rest); !word.empty(); word = next_word(rest)) {
      const auto value = to_number(word);
      if (!value || numbers.size() == 9) {
        throw InputError(
            path, fmt::format("line {}: '{}' is not a number of a calibration matrix (3 x 3)", line,
                              printable(word.substr(0, 40))));
      }
      numbers.push_back(*value);
    }
  }
  return camera_of_matrix(numbers, path);
}

bool is_colmap_line(std::string_view line) {
  (void)next_word(line);
  const std::string_view model = next_word(line);
  return !model.empty() && model.front() >= 'A' && model.front() <= 'Z' && model != "NaN";
}

Camera read_any(const std::string& text, const std::string& path,
                const CameraFileOptions& options) {
  if (text.starts_with("%YAML") || text.starts_with("<?xml"))
    return read_opencv(text, path, options);
  std::string_view rest = text;
  std::string_view first;  // first line with content
  while (!rest.empty() && (first.empty() || first.front() == '#')) first = trimmed(next_line(rest));
  if (first.empty() || first.front() == '#') throw InputError(path, "is empty");
  const bool is_key = (first.front() >= 'a' && first.front() <= 'z') ||
                      (first.front() >= 'A' && first.front() <= 'Z');
  if (first == "---" || (is_key && first.find(':') != std::string_view::npos))
    return OwnYamlParser(path).parse(text);
  if (first.front() >= '0' && first.front() <= '9' && is_colmap_line(first))
    return read_colmap_camera(text, path);
  std::string_view words = first;
  if (to_number(next_word(words))) return read_matrix(text, path);
  throw InputError(
      path,
      "is not a camera: expected camera.yaml, YAML or XML of OpenCV, cameras.txt of COLMAP or a "
      "3 x 3 matrix");
}

std::string joined(std::span<const double> numbers) {
  std::string text;
  for (const double value : numbers)
    text += fmt::format("{}{:.17g}", text.empty() ? "" : ", ", value);
  return text;
}

std::string own_text(const Camera& camera) {
  static constexpr std::array<const char*, 3> kOrder{
      "k1, k2, p1, p2, k3 as OpenCV has them", "k1, k2, p1, p2, k3, k4, k5, k6 as OpenCV has them",
      "k1, k2, k3, k4 as cv::fisheye has them"};
  return fmt::format(
      "# A camera of Tarsier; lengths in px, the middle of the top left pixel is 0.\n"
      "model: {}\nwidth: {}\nheight: {}\n"
      "fx: {:.17g}\nfy: {:.17g}\ncx: {:.17g}\ncy: {:.17g}\n"
      "# {}\ndistortion: [{}]\nrms: {:.17g}\n",
      name_of(camera.lens), camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy,
      kOrder[static_cast<std::size_t>(camera.lens)], joined(camera.coefficients()), camera.rms);
}

// Doubles with a decimal point, without which OpenCV's parser does not accept them as such.
std::string opencv_numbers(std::span<const double> numbers) {
  std::string text;
  for (const double value : numbers) {
    std::string number = fmt::format("{:.17g}", value);
    if (number.find_first_of(".e") == std::string::npos) number += '.';
    text += (text.empty() ? "" : ", ") + number;
  }
  return text;
}

std::string opencv_text(const Camera& camera) {
  std::string text = "%YAML:1.0\n---\n";
  if (camera.width > 0) {
    text += fmt::format("image_width: {}\nimage_height: {}\n", camera.width, camera.height);
  }
  const cv::Matx33d matrix = camera.matrix();
  text += fmt::format(
      "camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ {} ]\n",
      opencv_numbers(matrix.val));
  if (camera.lens == Lens::kFisheye) text += "fisheye_model: 1\n";
  const auto k = camera.coefficients();
  text += fmt::format(
      "distortion_coefficients: !!opencv-matrix\n   rows: {}\n   cols: 1\n   dt: d\n"
      "   data: [ {} ]\n",
      k.size(), opencv_numbers(k));
  if (camera.rms > 0)
    text += fmt::format("avg_reprojection_error: {}\n", opencv_numbers({&camera.rms, 1}));
  return text;
}

std::string colmap_text(const Camera& camera) {
  TARSIER_REQUIRE(camera.width > 0, "the size of the image is not known");
  return fmt::format(
      "# Camera list with one line of data per camera:\n"
      "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n{}\n",
      colmap_camera_line({1, camera}));
}

}  // namespace

Camera read_camera_file(const std::string& path, const CameraFileOptions& options) {
  std::string text = read_file(path, kMaxFileBytes);
  if (text.find('\0') != std::string::npos) throw InputError(path, "is not a text file");
  if (text.starts_with("\xEF\xBB\xBF")) text.erase(0, 3);
  const Camera camera = read_any(text, path, options);
  if (const std::string error = camera_error(camera); !error.empty()) throw InputError(path, error);
  return camera;
}

void write_camera_file(const std::string& path, const Camera& camera, CameraFormat format) {
  const std::string error = camera_error(camera);
  TARSIER_REQUIRE(error.empty(), "{}", error);
  write_file_atomically(path, format == CameraFormat::kOpencv   ? opencv_text(camera)
                              : format == CameraFormat::kColmap ? colmap_text(camera)
                                                                : own_text(camera));
}

Camera parse_camera(const std::string& text) {
  std::vector<double> numbers;
  std::string_view rest = text;
  while (true) {
    const std::size_t comma = rest.find(',');
    const std::string_view word = trimmed(rest.substr(0, comma));
    const auto value = to_number(word);
    if (!value || numbers.size() == 12) {
      throw UsageError(fmt::format(
          "camera '{}': {}; fx,fy,cx,cy[,k1,k2,p1,p2[,k3[,k4,k5,k6]]] is expected",
          printable(text.substr(0, 200)),
          value ? std::string("more than 12 numbers")
                : fmt::format("'{}' is not a finite number", printable(word.substr(0, 40)))));
    }
    numbers.push_back(*value);
    if (comma == std::string_view::npos) break;
    rest.remove_prefix(comma + 1);
  }
  if (numbers.size() != 4 && numbers.size() != 8 && numbers.size() != 9 && numbers.size() != 12) {
    throw UsageError(
        fmt::format("camera '{}': {} numbers; fx,fy,cx,cy[,k1,k2,p1,p2[,k3[,k4,k5,k6]]] is "
                    "expected",
                    printable(text), numbers.size()));
  }
  Camera camera;
  camera.fx = numbers[0];
  camera.fy = numbers[1];
  camera.cx = numbers[2];
  camera.cy = numbers[3];
  std::copy(numbers.begin() + 4, numbers.end(), camera.distortion.begin());
  if (numbers.size() == 12) camera.lens = Lens::kRational;
  if (const std::string error = camera_error(camera); !error.empty())
    throw UsageError(fmt::format("camera '{}': {}", printable(text), error));
  return camera;
}

}  // namespace tarsier::geometry
