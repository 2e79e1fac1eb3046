// SPDX-License-Identifier: MIT
#include "tarsier/render/obj_io.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <filesystem>
#include <map>
#include <string_view>
#include <system_error>

namespace tarsier::render {
namespace {

namespace fs = std::filesystem;

constexpr double kMaxNumber = 1e9;
constexpr std::size_t kMaxMaterials = 10'000;

// Splits a line into words.
class Words {
 public:
  explicit Words(std::string_view line) : rest_(line) {}
  std::string_view next() {  // "" at the end
    skip_space();
    std::size_t end = 0;
    while (end < rest_.size() && !is_space(rest_[end])) ++end;
    const std::string_view word = rest_.substr(0, end);
    rest_.remove_prefix(end);
    return word;
  }
  std::string_view rest() {  // to the end of the line: a name may contain spaces
    skip_space();
    while (!rest_.empty() && is_space(rest_.back())) rest_.remove_suffix(1);
    return rest_;
  }

 private:
  static bool is_space(char c) { return c == ' ' || c == '\t' || c == '\r'; }
  void skip_space() {
    while (!rest_.empty() && is_space(rest_.front())) rest_.remove_prefix(1);
  }
  std::string_view rest_;
};

// Splits a text into lines and counts them.
class Lines {
 public:
  explicit Lines(std::string_view text) : rest_(text) {}
  bool next(std::string_view& line) {
    if (rest_.empty()) return false;
    const std::size_t end = rest_.find('\n');
    line = rest_.substr(0, end);
    rest_.remove_prefix(end == std::string_view::npos ? rest_.size() : end + 1);
    ++number_;
    if (const std::size_t comment = line.find('#'); comment != std::string_view::npos) {
      line = line.substr(0, comment);
    }
    return true;
  }
  [[nodiscard]] int number() const { return number_; }

 private:
  std::string_view rest_;
  int number_ = 0;
};

// The characters of an untrusted file that a message may show.
std::string shown(std::string_view word) {
  std::string text;
  for (const char c : word.substr(0, 40)) text += c >= ' ' && c <= '~' ? c : '?';
  return word.size() > 40 ? text + ".." : text;
}

class Reader {
 public:
  Reader(std::string path, const ObjLimits& limits)
      : path_(std::move(path)), limits_(limits), folder_(fs::path(path_).parent_path()) {}

  ObjFile read() {
    const std::string text = read_file(path_, limits_.max_bytes);
    if (text.find('\0') != std::string::npos) throw InputError(path_, "is not an OBJ file");
    Lines lines(text);
    file_ = path_;
    lines_ = &lines;
    for (std::string_view line; lines.next(line);) read_line(line);
    if (result_.mesh.triangles.empty()) {
      throw InputError(path_, "has no faces: is it a Wavefront OBJ file?");
    }
    add_normals(result_.mesh);
    return std::move(result_);
  }

 private:
  [[noreturn]] void fail(const std::string& reason) const {
    throw InputError(file_, fmt::format("line {}: {}", lines_->number(), reason));
  }

  [[nodiscard]] float number(std::string_view word) const {
    double value = 0;
    if (!word.empty() && word.front() == '+') word.remove_prefix(1);
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    // Smaller than any double: treated as 0. For a larger number `value` is undefined.
    if (error == std::errc::result_out_of_range && is_below_one(word)) return 0;
    if (error != std::errc() || end != word.data() + word.size()) {
      fail(fmt::format("'{}' is not a number", shown(word)));
    }
    if (!(std::abs(value) <= kMaxNumber)) {
      fail(fmt::format("{} is not finite or beyond 1e9", shown(word)));
    }
    return static_cast<float>(value);
  }

  // Whether a number outside the range of double is too small rather than too large.
  static bool is_below_one(std::string_view word) {
    const std::size_t exponent = word.find_first_of("eE");
    if (exponent != std::string_view::npos) return word.substr(exponent + 1).starts_with('-');
    return word.find_first_not_of("-0") == word.find('.');
  }

  template <int N>
  cv::Vec<float, N> numbers(Words& words) const {
    cv::Vec<float, N> value;
    for (int k = 0; k < N; ++k) value[k] = number(words.next());
    return value;
  }

  template <typename Vector>
  void add(std::vector<Vector>& list, const Vector& value) const {
    if (list.size() >= static_cast<std::size_t>(limits_.max_faces)) {
      fail(fmt::format("more than {} vertices", limits_.max_faces));
    }
    list.push_back(value);
  }

  void read_line(std::string_view line) {
    Words words(line);
    const std::string_view key = words.next();
    Mesh& mesh = result_.mesh;
    if (key == "v") {
      add(mesh.positions, numbers<3>(words));
    } else if (key == "vt") {
      cv::Vec2f uv(number(words.next()), 0);
      if (const std::string_view v = words.next(); !v.empty()) uv[1] = number(v);
      add(mesh.uvs, uv);
    } else if (key == "vn") {
      cv::Vec3f normal = numbers<3>(words);
      const double length = cv::norm(normal);
      if (length > 0) normal = cv::Vec3f(cv::Vec3d(normal) / length);
      add(mesh.normals, normal);
    } else if (key == "f") {
      read_face(words);
    } else if (key == "usemtl") {
      use(std::string(words.rest()));
    } else if (key == "mtllib") {
      read_library(std::string(words.rest()));
    }
  }

  struct Corner {
    int position = -1;
    int uv = -1;
    int normal = -1;
  };

  // "5" -> 4, "-1" -> the last index.
  int index(std::string_view word, std::size_t count, const char* what) const {
    std::int64_t value = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc() || end != word.data() + word.size()) {
      fail(fmt::format("'{}' is not an index", shown(word)));
    }
    const auto size = static_cast<std::int64_t>(count);
    if (value < -size || value == 0 || value > size) {
      fail(fmt::format("{} {} of {} so far", what, value, count));
    }
    return static_cast<int>(value > 0 ? value - 1 : size + value);
  }

  [[nodiscard]] Corner corner(std::string_view word) const {
    const Mesh& mesh = result_.mesh;
    Corner result;
    const std::size_t first = word.find('/');
    result.position = index(word.substr(0, first), mesh.positions.size(), "vertex");
    if (first == std::string_view::npos) return result;
    word.remove_prefix(first + 1);
    const std::size_t second = word.find('/');
    if (const std::string_view uv = word.substr(0, second); !uv.empty()) {
      result.uv = index(uv, mesh.uvs.size(), "texture coordinate");
    }
    if (second == std::string_view::npos) return result;
    if (const std::string_view normal = word.substr(second + 1); !normal.empty()) {
      result.normal = index(normal, mesh.normals.size(), "normal");
    }
    return result;
  }

  void read_face(Words& words) {
    Corner first;
    Corner last;
    int count = 0;
    for (std::string_view word = words.next(); !word.empty(); word = words.next()) {
      const Corner here = corner(word);
      if (++count == 1) {
        first = here;
      } else if (count > 2) {
        add_triangle({first, last, here});
      }
      last = here;
    }
    if (count < 3) fail("a face of fewer than three vertices");
  }

  void add_triangle(const std::array<Corner, 3>& corners) {
    std::vector<Triangle>& triangles = result_.mesh.triangles;
    if (triangles.size() >= static_cast<std::size_t>(limits_.max_faces)) {
      fail(fmt::format("more than {} triangles", limits_.max_faces));
    }
    Triangle triangle;
    bool has_uv = true;
    bool has_normal = true;
    for (std::size_t k = 0; k < 3; ++k) {
      triangle.position[k] = corners[k].position;
      triangle.uv[k] = corners[k].uv;
      triangle.normal[k] = corners[k].normal;
      has_uv = has_uv && corners[k].uv >= 0;
      has_normal = has_normal && corners[k].normal >= 0;
    }
    if (!has_uv) triangle.uv = {-1, -1, -1};
    if (!has_normal) triangle.normal = {-1, -1, -1};
    triangle.material = material_;
    triangles.push_back(triangle);
  }

  void use(const std::string& name) {
    const auto [at, is_new] = materials_.try_emplace(name, -1);
    if (is_new) at->second = add_material(name);
    material_ = at->second;
  }

  int add_material(const std::string& name) {
    std::vector<Material>& materials = result_.mesh.materials;
    if (materials.size() >= kMaxMaterials)
      fail(fmt::format("more than {} materials", kMaxMaterials));
    materials.emplace_back().name = shown(name);
    return static_cast<int>(materials.size()) - 1;
  }

  // The path of a file named by the OBJ or MTL; "" if it does not exist. A link that leads out of
  // the folder counts as outside.
  [[nodiscard]] std::string companion(const std::string& name) const {
    const fs::path given(name);
    if (name.empty() || name.find('\0') != std::string::npos || given.is_absolute()) {
      fail(fmt::format("'{}' is not the name of a file beside the OBJ file", shown(name)));
    }
    std::error_code error;
    const fs::path base = fs::weakly_canonical(folder_.empty() ? fs::path(".") : folder_, error);
    const fs::path absolute = error ? fs::path() : fs::weakly_canonical(base / given, error);
    const fs::path relative = absolute.lexically_relative(base);
    if (error || relative.empty() || *relative.begin() == "..") {
      fail(fmt::format("'{}' is outside the folder of the OBJ file", shown(name)));
    }
    return fs::is_regular_file(absolute, error) ? absolute.string() : std::string();
  }

  void read_library(const std::string& name) {
    const std::string path = companion(name);
    if (path.empty()) {
      result_.notes.push_back(
          fmt::format("{}: the material library '{}' is missing: grey", path_, shown(name)));
      return;
    }
    if (++libraries_ > 16) fail("more than 16 material libraries");
    const std::string text = read_file(path, limits_.max_bytes / 64);
    Lines lines(text);
    const std::string outer_file = std::exchange(file_, path);
    const Lines* outer_lines = std::exchange(lines_, &lines);
    int material = -1;
    for (std::string_view line; lines.next(line);) read_library_line(line, material);
    file_ = outer_file;
    lines_ = outer_lines;
  }

  void read_library_line(std::string_view line, int& material) {
    Words words(line);
    const std::string_view key = words.next();
    if (key == "newmtl") {
      const std::string name(words.rest());
      const auto [at, is_new] = materials_.try_emplace(name, -1);
      if (is_new) at->second = add_material(name);
      material = at->second;
    } else if (material < 0) {
      return;
    } else if (key == "Kd") {
      const cv::Vec3f rgb = numbers<3>(words);
      for (int k = 0; k < 3; ++k) {
        if (!(rgb[k] >= 0 && rgb[k] <= 1)) fail("a colour outside 0..1");
      }
      result_.mesh.materials[static_cast<std::size_t>(material)].color = {rgb[2], rgb[1], rgb[0]};
    } else if (key == "map_Kd") {
      const std::string name(words.rest());
      if (name.starts_with("-")) fail("options of map_Kd are not known: name the image alone");
      result_.mesh.materials[static_cast<std::size_t>(material)].texture = texture(name);
    }
  }

  int texture(const std::string& name) {
    const std::string path = companion(name);
    if (path.empty()) {
      result_.notes.push_back(
          fmt::format("{}: the texture '{}' is missing: left out", file_, shown(name)));
      return -1;
    }
    const auto [at, is_new] = textures_.try_emplace(path, -1);
    if (!is_new) return at->second;
    if (result_.mesh.textures.size() >= static_cast<std::size_t>(limits_.max_textures)) {
      fail(fmt::format("more than {} textures", limits_.max_textures));
    }
    ImageLimits image_limits;
    image_limits.max_pixels = limits_.max_texture_pixels;
    result_.mesh.textures.push_back(make_texture(read_image(path, image_limits)));
    at->second = static_cast<int>(result_.mesh.textures.size()) - 1;
    return at->second;
  }

  std::string path_;
  ObjLimits limits_;
  fs::path folder_;
  std::string file_;              // the file being read
  const Lines* lines_ = nullptr;  // of this file
  ObjFile result_;
  std::map<std::string, int> materials_;
  std::map<std::string, int> textures_;
  int material_ = -1;
  int libraries_ = 0;
};

}  // namespace

ObjFile read_obj(const std::string& path, const ObjLimits& limits) {
  return Reader(path, limits).read();
}

}  // namespace tarsier::render
