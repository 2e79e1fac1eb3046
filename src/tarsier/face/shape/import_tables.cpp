// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/words.h"
#include "tarsier/face/shape/import_text.h"
#include "tarsier/face/shape/markup_check.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <map>
#include <utility>

namespace tarsier::face::shape {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kMaxTableBytes = 50'000'000;
constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();

bool is_plain_name(std::string_view name) {
  return !name.empty() && name.size() <= 255 && name.find('/') == std::string_view::npos &&
         name.find('\0') == std::string_view::npos && name != "." && name != "..";
}

// "i000" of "i000qa-fn": letters, then digits.
std::string muct_person(std::string_view name) {
  constexpr std::string_view kDigits = "0123456789";
  const std::size_t first = name.find_first_of(kDigits);
  if (first == std::string_view::npos) return "";
  return std::string(name.substr(0, name.find_first_not_of(kDigits, first)));
}

// The tags of an XML text, sufficient for the output of dlib's imglab: no entity definitions, no
// check of nesting, no expansion.
class XmlTags {
 public:
  XmlTags(const std::string& path, std::string_view text) : path_(path), text_(text) {}

  struct Tag {
    std::string_view name;
    bool is_end = false;    // </name>
    bool is_empty = false;  // <name/>
    std::map<std::string_view, std::string_view> attributes;
  };

  // False at the end of the text.
  bool next(Tag& tag) {
    while (true) {
      at_ = text_.find('<', at_);
      if (at_ == std::string_view::npos) return false;
      start_ = at_;
      if (text_.substr(at_).starts_with("<!--")) {
        skip_behind("-->");
      } else if (text_.substr(at_).starts_with("<?")) {
        skip_behind("?>");
      } else if (text_.substr(at_).starts_with("<!")) {
        fail("declarations are not read");
      } else {
        read(tag);
        return true;
      }
    }
  }

  [[noreturn]] void fail(const std::string& reason) const {
    const std::string_view before = text_.substr(0, std::min(start_, text_.size()));
    throw InputError(
        path_,
        fmt::format("line {}: {}", std::count(before.begin(), before.end(), '\n') + 1, reason));
  }

  [[nodiscard]] std::string text_of(const Tag& tag, std::string_view name) const {
    const auto found = tag.attributes.find(name);
    if (found == tag.attributes.end()) fail(fmt::format("'{}' is missing", name));
    std::string result;
    for (std::string_view rest = found->second; !rest.empty();) {
      if (rest.front() != '&') {
        result += rest.front();
        rest.remove_prefix(1);
        continue;
      }
      const std::size_t end = rest.find(';');
      const std::string_view entity =
          end == std::string_view::npos ? rest : rest.substr(0, end + 1);
      static const std::map<std::string_view, char> kEntities{
          {"&amp;", '&'}, {"&lt;", '<'}, {"&gt;", '>'}, {"&quot;", '"'}, {"&apos;", '\''}};
      const auto known = kEntities.find(entity);
      if (known == kEntities.end()) fail("an entity that is not known");
      result += known->second;
      rest.remove_prefix(entity.size());
    }
    return result;
  }

  [[nodiscard]] double number_of(const Tag& tag, std::string_view name) const {
    const auto found = tag.attributes.find(name);
    if (found == tag.attributes.end()) fail(fmt::format("'{}' is missing", name));
    const auto value = to_number(found->second);
    if (!value || std::abs(*value) > kMaxImportedCoordinate)
      fail(fmt::format("'{}': expected a number", name));
    return *value;
  }

 private:
  void skip_behind(std::string_view mark) {
    const std::size_t end = text_.find(mark, at_ + 2);
    if (end == std::string_view::npos) fail("ends too early");
    at_ = end + mark.size();
  }

  void skip_blanks() { at_ = std::min(text_.find_first_not_of(" \t\r\n", at_), text_.size()); }

  [[nodiscard]] std::string_view read_name() {
    const std::size_t end = std::min(text_.find_first_of(" \t\r\n/>='\"<", at_), text_.size());
    const std::string_view name = text_.substr(at_, end - at_);
    at_ = end;
    return name;
  }

  [[nodiscard]] char here() const { return at_ < text_.size() ? text_[at_] : '\0'; }

  void read(Tag& tag) {
    tag = {};
    ++at_;
    if (here() == '/') {
      tag.is_end = true;
      ++at_;
    }
    tag.name = read_name();
    while (true) {
      skip_blanks();
      if (here() == '>') break;
      if (here() == '/') {
        tag.is_empty = true;
        ++at_;
        continue;
      }
      const std::string_view name = read_name();
      skip_blanks();
      if (name.empty() || here() != '=') fail("no XML");
      ++at_;
      skip_blanks();
      const char quote = here();
      if (quote != '\'' && quote != '"') fail("an attribute without quotes");
      const std::size_t end = text_.find(quote, at_ + 1);
      if (end == std::string_view::npos) fail("ends too early");
      tag.attributes[name] = text_.substr(at_ + 1, end - at_ - 1);
      at_ = end + 1;
    }
    ++at_;
  }

  const std::string& path_;
  std::string_view text_;
  std::size_t at_ = 0;
  std::size_t start_ = 0;  // start of the last tag that was read
};

struct Box {
  std::string image;  // "": its image is missing
  cv::Rect2d rect;
  std::map<int, Eigen::Vector2d> parts;
};

// Limits the memory that a few large names of parts could cause.
constexpr std::int64_t kMaxBoxPoints = 20'000'000;

class DlibReader {
 public:
  DlibReader(const std::string& path, const ImportOptions& options, std::string_view text)
      : path_(path), options_(options), tags_(path, text) {}

  void read(Imported& imported) {
    read_tags(imported.skipped);
    deliver(imported);
  }

  // All boxes, including those without parts, and the images without boxes.
  BoxedImages read_boxes() {
    BoxedImages result;
    images_ = &result.images;
    read_tags(result.skipped);
    images_ = nullptr;
    return result;
  }

 private:
  void read_tags(std::vector<std::string>& skipped) {
    XmlTags::Tag tag;
    while (tags_.next(tag)) {
      if (tag.name == "image") {
        image_ = tag.is_end ? "" : image_path(tags_.text_of(tag, "file"), skipped);
        is_image_ = !tag.is_end && !tag.is_empty;
        if (images_ != nullptr && !image_.empty()) images_->push_back({image_, {}, {}, {}});
      } else if (tag.name == "box") {
        if (!tag.is_end) start_box(tag);
        if (tag.is_end || tag.is_empty) finish_box();
      } else if (tag.name == "part" && !tag.is_end) {
        add_part(tag);
      }
    }
    if (is_box_) throw InputError(path_, "ends too early (a box is open)");
  }

  std::string image_path(const std::string& file, std::vector<std::string>& skipped) const {
    if (file.empty() || file.size() > 4096 || file.find('\0') != std::string::npos)
      tags_.fail("no path of an image");
    const fs::path folder =
        options_.images.empty() ? fs::path(path_).parent_path() : fs::path(options_.images);
    std::string image = (folder / file).string();
    std::error_code error;
    if (fs::is_regular_file(image, error)) return image;
    skipped.push_back(image + ": no such image");
    return "";
  }

  void start_box(const XmlTags::Tag& tag) {
    if (is_box_) tags_.fail("a box in a box");
    if (!is_image_) tags_.fail("a box without an image");
    is_box_ = true;
    box_ = {};
    box_.image = image_;
    box_.rect = {tags_.number_of(tag, "left"), tags_.number_of(tag, "top"),
                 tags_.number_of(tag, "width"), tags_.number_of(tag, "height")};
    if (!(box_.rect.width > 0 && box_.rect.height > 0)) tags_.fail("a box without area");
    const auto ignore = tag.attributes.find("ignore");
    is_ignored_ = ignore != tag.attributes.end() && ignore->second != "0";
  }

  void finish_box() {
    if (images_ != nullptr) {
      keep_box();
    } else if (is_box_ && !is_ignored_ && !box_.image.empty() && !box_.parts.empty())
      boxes_.push_back(std::move(box_));
    is_box_ = false;
  }

  void keep_box() {
    if (!is_box_ || box_.image.empty()) return;
    BoxedImage& image_path = images_->back();
    if (is_ignored_) {
      image_path.ignored.push_back(box_.rect);
      return;
    }
    const int count = box_.parts.empty() ? 0 : box_.parts.rbegin()->first + 1;
    kept_points_ += count;
    if (kept_points_ > kMaxBoxPoints)
      throw InputError(path_, fmt::format("boxes of more than {} points in all", kMaxBoxPoints));
    Eigen::Matrix2Xd shape = Eigen::Matrix2Xd::Constant(2, count, kMissing);
    for (const auto& [point, at] : box_.parts) shape.col(point) = at;
    image_path.boxes.push_back(box_.rect);
    image_path.shapes.push_back(std::move(shape));
  }

  void add_part(const XmlTags::Tag& tag) {
    if (!is_box_) tags_.fail("a part without a box");
    const double name = tags_.number_of(tag, "name");
    if (name != std::floor(name) || name < 0 || name >= kMaxPoints)
      tags_.fail("the name of a part is not the number of a point");
    const Eigen::Vector2d at(tags_.number_of(tag, "x"), tags_.number_of(tag, "y"));
    if (!box_.parts.emplace(static_cast<int>(name), at).second) tags_.fail("a part twice");
  }

  void deliver(Imported& imported) const {
    int count = 0;
    for (const Box& box : boxes_) count = std::max(count, box.parts.rbegin()->first + 1);
    LandmarkSet& set = imported.set;
    if (count > 0 && !set.samples.empty() && set.points() != count) {
      imported.skipped.push_back(
          fmt::format("{}: {} points, the others {}", path_, count, set.points()));
      return;
    }
    if (count * static_cast<std::int64_t>(boxes_.size()) > kMaxBoxPoints)
      throw InputError(path_, fmt::format("{} boxes of {} points", boxes_.size(), count));
    for (const Box& box : boxes_) {
      LandmarkSample sample;
      sample.image = box.image;
      sample.box = box.rect;
      sample.points = Eigen::Matrix2Xd::Constant(2, count, kMissing);
      for (const auto& [point, at] : box.parts) sample.points.col(point) = at;
      set.samples.push_back(std::move(sample));
    }
  }

  const std::string& path_;
  const ImportOptions& options_;
  XmlTags tags_;
  std::string image_;
  bool is_image_ = false;
  bool is_box_ = false;
  bool is_ignored_ = false;
  Box box_;
  std::vector<Box> boxes_;
  std::vector<BoxedImage>* images_ = nullptr;  // set if all boxes are requested
  std::int64_t kept_points_ = 0;
};

}  // namespace

void import_dlib(const std::string& path, const ImportOptions& options, Imported& imported) {
  const std::string text = read_file(path, kMaxTableBytes);
  DlibReader(path, options, text).read(imported);
}

BoxedImages read_dlib_boxes(const std::string& path, const ImportOptions& options) {
  const std::string text = read_file(path, kMaxTableBytes);
  BoxedImages result = DlibReader(path, options, text).read_boxes();
  if (result.images.empty()) {
    throw InputError(path, result.skipped.empty() ? "names no images"
                                                  : "none of its images is there; the first: " +
                                                        result.skipped.front());
  }
  return result;
}

void import_muct(const std::string& path, const ImportOptions& options, Imported& imported) {
  const std::string text = read_file(path, kMaxTableBytes);
  TextLines lines(path, text);
  const fs::path folder = fs::path(path).parent_path();
  std::vector<fs::path> folders;
  if (!options.images.empty()) folders.emplace_back(options.images);
  for (const char* below : {"", "jpg", "../jpg"}) folders.push_back(folder / below);

  bool is_header = true;
  while (const auto line = lines.next()) {
    if (line->empty()) continue;
    if (std::exchange(is_header, false)) {
      if (!line->starts_with("name,")) lines.fail("the header name,tag,x00,y00,.. is missing");
      continue;
    }
    std::optional<std::string_view> rest = line;
    const std::string_view name = *next_cell(rest);
    if (!is_plain_name(name)) lines.fail("no name of an image");
    (void)next_cell(rest);  // tag
    std::vector<double> numbers;
    while (const auto cell = next_cell(rest)) {
      if (numbers.size() >= 2 * static_cast<std::size_t>(kMaxPoints))
        lines.fail(fmt::format("more than {} points", kMaxPoints));
      numbers.push_back(lines.number(*cell, kMaxImportedCoordinate));
      if (numbers.back() < 0)
        lines.fail("a coordinate below 0: centred as Stasm has them? take muct76-opencv.csv");
    }
    if (numbers.empty() || numbers.size() % 2 != 0) lines.fail("x,y pairs are expected");
    LandmarkSample sample;
    sample.points = Eigen::Map<const Eigen::Matrix2Xd>(
        numbers.data(), 2, static_cast<Eigen::Index>(numbers.size() / 2));
    for (Eigen::Index i = 0; i < sample.points.cols(); ++i)
      if (sample.points.col(i).isZero(0)) sample.points.col(i).setConstant(kMissing);
    LandmarkSet& set = imported.set;
    if (!set.samples.empty() && set.points() != sample.points.cols())
      lines.fail(fmt::format("{} points, {} before", sample.points.cols(), set.points()));
    for (const fs::path& image_folder : folders) {
      sample.image = find_image((image_folder / name).string());
      if (!sample.image.empty()) break;
    }
    if (sample.image.empty()) {
      imported.skipped.push_back((folder / name).string() + ": no image of that name");
      continue;
    }
    sample.person = muct_person(name);
    set.samples.push_back(std::move(sample));
  }
}

}  // namespace tarsier::face::shape
