// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/import.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/file_extension.h"
#include "tarsier/core/words.h"
#include "tarsier/face/shape/import_text.h"
#include "tarsier/face/shape/markup_check.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <set>
#include <system_error>
#include <utility>

namespace tarsier::face::shape {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kMaxShapeBytes = 4'000'000;  // max size of a file with one shape
constexpr std::int64_t kMaxListBytes = 20'000'000;
constexpr double kMaxRelative = 10;  // ASF: images are 0..1

ImportFormat format_of(const std::string& ending) {
  if (ending == ".pts") return ImportFormat::kPts;
  if (ending == ".asf") return ImportFormat::kAsf;
  if (ending == ".csv") return ImportFormat::kMuct;
  if (ending == ".xml") return ImportFormat::kDlib;
  return ImportFormat::kAuto;
}

bool is_file(const fs::path& path) {
  std::error_code error;
  return fs::is_regular_file(path, error);
}

// "01" of "01-1m" and "01_01".
std::string imm_person(const std::string& stem) {
  std::size_t digits = 0;
  while (digits < stem.size() && stem[digits] >= '0' && stem[digits] <= '9') ++digits;
  const bool is_name =
      digits > 0 && digits < stem.size() && (stem[digits] == '-' || stem[digits] == '_');
  return is_name ? stem.substr(0, digits) : "";
}

std::string reason_of(const Error& error, const std::string& path) {
  std::string reason = error.what();
  if (reason.starts_with(path + ": ")) reason.erase(0, path.size() + 2);
  return reason;
}

class ShapeFiles {
 public:
  ShapeFiles(const ImportOptions& options, Imported& imported)
      : options_(options), imported_(imported) {}

  // Adds the shape of one .pts or .asf file. Throws InputError.
  void add(const fs::path& path, ImportFormat format) {
    LandmarkSample sample;
    std::vector<std::array<int, 2>> connections;
    if (format == ImportFormat::kAsf) {
      AsfShape shape = read_asf(path.string());
      sample.image = image_of(path, shape.image);
      const cv::Mat image = read_image(sample.image);
      sample.points = shape.relative;
      sample.points.row(0) *= image.cols;
      sample.points.row(1) *= image.rows;
      sample.person = imm_person(path.stem().string());
      connections = std::move(shape.connections);
    } else {
      sample.points = read_pts(path.string(), options_.pts_offset);
      sample.image = image_of(path, "");
    }
    LandmarkSet& set = imported_.set;
    if (!set.samples.empty() && set.points() != sample.points.cols()) {
      throw InputError(path.string(),
                       fmt::format("{} points, the others {}", sample.points.cols(), set.points()));
    }
    if (set.connections.empty()) set.connections = std::move(connections);
    set.samples.push_back(std::move(sample));
  }

  void add_or_skip(const fs::path& path, ImportFormat format) {
    try {
      add(path, format);
    } catch (const IoError& error) {
      imported_.skipped.push_back(path.string() + ": " + reason_of(error, path.string()));
    }
  }

 private:
  [[nodiscard]] std::string image_of(const fs::path& path, const std::string& host) const {
    std::vector<fs::path> folders;
    if (!options_.images.empty()) folders.emplace_back(options_.images);
    folders.push_back(path.parent_path());
    for (const fs::path& folder : folders) {
      std::string image = find_image((folder / path.stem()).string());
      if (!image.empty()) return image;
      // Accept only a plain file name: the annotation must not refer to other folders.
      if (!host.empty() && host.find('/') == std::string::npos &&
          host.find('\0') == std::string::npos && is_file(folder / host)) {
        return (folder / host).string();
      }
    }
    throw InputError(path.string(), "no image of that name");
  }

  const ImportOptions& options_;
  Imported& imported_;
};

void import_file(const std::string& path, ImportFormat format, const ImportOptions& options,
                 Imported& imported) {
  switch (format) {
    case ImportFormat::kPts:
    case ImportFormat::kAsf:
      return ShapeFiles(options, imported).add(path, format);
    case ImportFormat::kMuct:
      return import_muct(path, options, imported);
    case ImportFormat::kDlib:
      return import_dlib(path, options, imported);
    case ImportFormat::kAuto:
      break;
  }
  throw InputError(path, "no annotation (.pts, .asf, .csv, .xml, .txt or a folder is expected)");
}

void import_folder(const std::string& path, const ImportOptions& options, Imported& imported) {
  std::vector<fs::path> files;
  std::error_code error;
  fs::directory_iterator at(path, error);
  for (; !error && at != fs::directory_iterator(); at.increment(error)) {
    const ImportFormat format = format_of(lowercase_extension(at->path().string()));
    const bool is_wanted = options.format == ImportFormat::kAuto
                               ? format == ImportFormat::kPts || format == ImportFormat::kAsf
                               : format == options.format;
    if (is_wanted && is_file(at->path())) files.push_back(at->path());
  }
  if (error) throw InputError(path, error.message());
  if (files.empty() && options.format == ImportFormat::kAuto) {
    // A folder with a table, like those of dlib and MUCT.
    for (const ImportFormat table : {ImportFormat::kDlib, ImportFormat::kMuct}) {
      ImportOptions of_table = options;
      of_table.format = table;
      import_folder(path, of_table, imported);
      if (!imported.set.samples.empty()) return;
    }
    return;
  }
  std::sort(files.begin(), files.end());
  ShapeFiles shapes(options, imported);
  for (const fs::path& file : files) {
    const ImportFormat format = format_of(lowercase_extension(file.string()));
    if (format == ImportFormat::kPts || format == ImportFormat::kAsf)
      shapes.add_or_skip(file, format);
    else
      import_file(file.string(), format, options, imported);
  }
}

void import_list(const std::string& path, const ImportOptions& options, Imported& imported) {
  const std::string text = read_file(path, kMaxListBytes);
  TextLines lines(path, text);
  ShapeFiles shapes(options, imported);
  const fs::path folder = fs::path(path).parent_path();
  while (const auto line = lines.next()) {
    if (line->empty() || line->front() == '#') continue;
    if (line->find('\0') != std::string_view::npos || line->size() > 4096) lines.fail("no path");
    const fs::path image = folder / fs::path(std::string(*line));
    bool is_found = false;
    for (const auto& [ending, format] :
         {std::pair(".pts", ImportFormat::kPts), std::pair(".asf", ImportFormat::kAsf)}) {
      if (options.format != ImportFormat::kAuto && options.format != format) continue;
      fs::path annotation = image;
      annotation.replace_extension(ending);
      if (!is_file(annotation)) continue;
      shapes.add_or_skip(annotation, format);
      is_found = true;
      break;
    }
    if (!is_found) imported.skipped.push_back(image.string() + ": no annotation beside it");
  }
}

}  // namespace

TextLines::TextLines(std::string path, std::string_view text)
    : path_(std::move(path)), rest_(text) {
  if (rest_.starts_with("\xEF\xBB\xBF")) rest_.remove_prefix(3);
}

std::optional<std::string_view> TextLines::next() {
  if (rest_.empty()) return std::nullopt;
  ++line_;
  return trimmed(next_line(rest_));
}

void TextLines::fail(const std::string& reason) const {
  throw InputError(path_, fmt::format("line {}: {}", line_, reason));
}

double TextLines::number(std::string_view word, double max_abs) const {
  const auto value = to_number(word);
  if (!value || std::abs(*value) > max_abs) fail("a number is expected");
  return *value;
}

int TextLines::integer(std::string_view word, int low, int high) const {
  const auto value = to_integer(word, low, high);
  if (!value) fail(fmt::format("a whole number in {}..{} is expected", low, high));
  return static_cast<int>(*value);
}

std::optional<std::string_view> next_cell(std::optional<std::string_view>& rest) {
  if (!rest) return std::nullopt;
  const std::size_t comma = rest->find(',');
  const std::string_view cell = trimmed(rest->substr(0, comma));
  if (comma == std::string_view::npos)
    rest.reset();
  else
    rest->remove_prefix(comma + 1);
  return cell;
}

std::string find_image(const std::string& stem) {
  for (const char* ending : {".jpg", ".jpeg", ".png", ".bmp", ".pgm", ".ppm", ".JPG", ".JPEG",
                             ".PNG", ".BMP", ".PGM", ".PPM"}) {
    if (is_file(stem + ending)) return stem + ending;
  }
  return "";
}

Eigen::Matrix2Xd read_pts(const std::string& path, double offset) {
  const std::string text = read_file(path, kMaxShapeBytes);
  TextLines lines(path, text);
  int announced = -1;
  bool is_open = false;
  while (auto line = lines.next()) {
    if (*line == "{") {
      is_open = true;
      break;
    }
    std::string_view rest = *line;
    const std::string_view key = next_word(rest);
    if (key == "n_points:") announced = lines.integer(next_word(rest), 1, kMaxPoints);
  }
  if (!is_open) throw InputError(path, "no points (a line \"{\" is missing)");
  std::vector<Eigen::Vector2d> points;
  bool is_closed = false;
  while (auto line = lines.next()) {
    if (line->empty()) continue;
    if (*line == "}") {
      is_closed = true;
      break;
    }
    std::string_view rest = *line;
    const double x = lines.number(next_word(rest), kMaxImportedCoordinate);
    const double y = lines.number(next_word(rest), kMaxImportedCoordinate);
    if (!trimmed(rest).empty()) lines.fail("x and y are expected");
    if (points.size() >= static_cast<std::size_t>(kMaxPoints))
      lines.fail(fmt::format("more than {} points", kMaxPoints));
    points.emplace_back(x - offset, y - offset);
  }
  if (!is_closed) throw InputError(path, "ends too early (a line \"}\" is missing)");
  if (points.empty()) throw InputError(path, "no points");
  if (announced >= 0 && static_cast<std::size_t>(announced) != points.size())
    throw InputError(path, fmt::format("{} points, {} announced", points.size(), announced));
  Eigen::Matrix2Xd result(2, static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i)
    result.col(static_cast<Eigen::Index>(i)) = points[i];
  return result;
}

AsfShape read_asf(const std::string& path) {
  const std::string text = read_file(path, kMaxShapeBytes);
  TextLines lines(path, text);
  const auto next = [&]() -> std::string_view {
    while (const auto line = lines.next())
      if (!line->empty() && line->front() != '#') return *line;
    throw InputError(path, "ends too early");
  };
  const int count = lines.integer(next(), 1, kMaxPoints);
  AsfShape shape;
  shape.relative.resize(2, count);
  std::set<std::array<int, 2>> connections;
  std::vector<bool> is_seen(static_cast<std::size_t>(count), false);
  for (int k = 0; k < count; ++k) {
    std::string_view rest = next();
    (void)next_word(rest);  // path
    (void)next_word(rest);  // type
    const double x = lines.number(next_word(rest), kMaxRelative);
    const double y = lines.number(next_word(rest), kMaxRelative);
    const int point = lines.integer(next_word(rest), 0, count - 1);
    const int from = lines.integer(next_word(rest), 0, count - 1);
    const int to = lines.integer(next_word(rest), 0, count - 1);
    if (is_seen[static_cast<std::size_t>(point)]) lines.fail(fmt::format("point {} twice", point));
    is_seen[static_cast<std::size_t>(point)] = true;
    shape.relative.col(point) << x, y;
    // Ends of open lines are connected to themselves.
    for (const int other : {from, to})
      if (other != point) connections.insert({std::min(point, other), std::max(point, other)});
  }
  shape.connections.assign(connections.begin(), connections.end());
  shape.image = std::string(next());
  return shape;
}

Imported import_landmarks(const std::string& input, const ImportOptions& options) {
  Imported imported;
  std::error_code error;
  const ImportFormat own = format_of(lowercase_extension(input));
  if (fs::is_directory(input, error)) {
    import_folder(input, options, imported);
  } else if (own == ImportFormat::kAuto && lowercase_extension(input) == ".txt") {
    import_list(input, options, imported);
  } else {
    import_file(input, options.format == ImportFormat::kAuto ? own : options.format, options,
                imported);
  }
  LandmarkSet& set = imported.set;
  if (set.samples.empty()) {
    throw InputError(input,
                     imported.skipped.empty()
                         ? "no annotation found: expected a set of landmarks, or images with "
                           ".pts files beside them"
                         : fmt::format("nothing left of {} ({})", imported.skipped.size(),
                                       imported.skipped.front()));
  }
  if (auto markup = known_markup(set.points())) {
    if (set.mirror.empty()) set.mirror = std::move(markup->mirror);
    if (set.connections.empty()) set.connections = std::move(markup->connections);
  }
  set.check();
  return imported;
}

}  // namespace tarsier::face::shape
