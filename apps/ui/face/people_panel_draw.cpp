// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "ui/face/people_panel.h"
#include "ui/overlay.h"
#include <algorithm>

namespace tarsier {
namespace {

const cv::Scalar kSelectedFill{95, 80, 60};
const cv::Scalar kMarkedColor{60, 60, 235};
const cv::Scalar kPale{170, 170, 170};
constexpr int kThumb = 46;      // px, a face
constexpr int kRow = 54;        // px, a row with faces
constexpr int kLine = 34;       // px, a row of the log
constexpr int kCellWidth = 62;  // px, a face of the grid with its number
constexpr int kCellHeight = 68;
constexpr int kTitle = 26;  // px
constexpr int kHint = 22;
constexpr int kText = 142;  // px, beside the faces of a row

void write(cv::Mat& image, std::string_view text, cv::Point at, double height,
           const cv::Scalar& color = {255, 255, 255}) {
  image::draw::put_text(
      image, text, at,
      {.height_px = height, .color = color, .backing = image::draw::Backing::kNone});
}

// Truncates `text` to `width` px.
std::string fitted(std::string text, double height, int width) {
  while (text.size() > 3 && image::draw::text_size(text, height).width > width)
    text = text.substr(0, text.size() - 3) + "..";
  return text;
}

}  // namespace

cv::Mat face_thumbnail(const cv::Mat& crop, int side) {
  const cv::Mat part =
      crop(cv::Rect(0, crop.rows / 10, crop.cols, std::min(crop.cols, crop.rows - crop.rows / 10)));
  cv::Mat small;
  cv::resize(part, small, {side, side}, 0, 0, cv::INTER_AREA);
  cv::cvtColor(small, small, cv::COLOR_GRAY2BGR);
  return small;
}

const cv::Mat& PeoplePanel::thumbnail(std::int64_t face) {
  const auto [entry, fresh] = thumbnails_.try_emplace(face);
  if (!fresh) return entry->second;
  cv::Mat crop;
  if (list_ == List::kPeople || list_ == List::kFacesOfPerson) {
    if (const auto stored = gallery_.face(face)) crop = stored->crop;
  } else if (const auto seen = gallery_.sighting_face(face)) {
    crop = seen->crop;
  }
  if (!crop.empty()) entry->second = face_thumbnail(crop, kThumb);
  return entry->second;
}

cv::Rect PeoplePanel::row_box(std::size_t row) const {
  for (const Cell& cell : cells_)
    if (cell.row == row) return cell.box;
  return {};
}

std::string PeoplePanel::title() const {
  switch (list_) {
    case List::kGroups:
      return fmt::format("Unknown faces: {} group{}", rows_.size(), rows_.size() == 1 ? "" : "s");
    case List::kPeople:
      return fmt::format("People: {}", rows_.size());
    case List::kFacesOfGroup:
      return fmt::format("Faces of group {}", group_);
    case List::kFacesOfPerson:
      return fmt::format("Faces of {}", printable(person_));
    case List::kCorrections:
      return "Corrections";
    case List::kNone:
      break;
  }
  return "";
}

std::string PeoplePanel::hint() const {
  if (is_confirming_ && selected_row() != nullptr)
    return fmt::format("Forget {} permanently?   y: yes   n: no", selected_row()->title);
  switch (list_) {
    case List::kGroups:
      return "w: name   Enter: faces   m: mark   j: merge marked   f: forget   Esc: back";
    case List::kPeople:
      return "Enter: faces   m: mark   j: merge marked   f: forget   Esc: back";
    case List::kFacesOfGroup:
      return "m: mark   s: split off marked   w: name the group   Esc: back";
    case List::kFacesOfPerson:
      return "m: mark   x: reject marked   w: move marked   Esc: back";
    case List::kCorrections:
      return "u: undo the selected one   Esc: back";
    case List::kNone:
      break;
  }
  return "";
}

void PeoplePanel::draw_rows(cv::Mat& image, const cv::Rect& area) {
  const bool log = list_ == List::kCorrections;
  const int height = log ? kLine : kRow;
  const auto room = static_cast<std::size_t>(std::max(1, area.height / height));
  first_ = std::min(first_, selected_);
  if (selected_ >= first_ + room) first_ = selected_ + 1 - room;
  for (std::size_t i = first_; i < std::min(rows_.size(), first_ + room); ++i) {
    const Row& row = rows_[i];
    const cv::Rect box(area.x, area.y + static_cast<int>(i - first_) * height, area.width,
                       height - 2);
    cells_.push_back({i, box});
    if (i == selected_) image::draw::fill_rounded(image, box, 4, kSelectedFill, 0.9);
    if (marked_.contains(row.id)) cv::rectangle(image, box, kMarkedColor, 2);
    if (log) {
      write(image, fitted(row.title, 9, box.width - 12), {box.x + 6, box.y + 2}, 9);
      write(image, fitted(row.detail, 8, box.width - 12), {box.x + 6, box.y + 17}, 8, kPale);
      continue;
    }
    write(image, fitted(row.title, 10, kText - 8), {box.x + 6, box.y + 2}, 10);
    write(image, row.detail, {box.x + 6, box.y + 19}, 8, kPale);
    int x = box.x + kText;
    for (const std::int64_t face : best_faces(row)) {
      if (x + kThumb > box.br().x - 4) break;
      const cv::Mat& small = thumbnail(face);
      if (!small.empty()) small.copyTo(image(cv::Rect(x, box.y + 3, kThumb, kThumb)));
      x += kThumb + 4;
    }
  }
}

void PeoplePanel::draw_faces(cv::Mat& image, const cv::Rect& area) {
  const auto columns = static_cast<std::size_t>(std::max(1, area.width / kCellWidth));
  const auto lines = static_cast<std::size_t>(std::max(1, area.height / kCellHeight));
  first_ = first_ / columns * columns;
  if (selected_ < first_) first_ = selected_ / columns * columns;
  if (selected_ >= first_ + columns * lines) first_ = (selected_ / columns + 1 - lines) * columns;
  for (std::size_t i = first_; i < std::min(rows_.size(), first_ + columns * lines); ++i) {
    const std::size_t at = i - first_;
    const cv::Rect box(area.x + static_cast<int>(at % columns) * kCellWidth,
                       area.y + static_cast<int>(at / columns) * kCellHeight, kCellWidth - 4,
                       kCellHeight - 4);
    cells_.push_back({i, box});
    if (i == selected_) image::draw::fill_rounded(image, box, 4, kSelectedFill, 0.9);
    const cv::Mat& small = thumbnail(rows_[i].id);
    if (!small.empty())
      small.copyTo(image(cv::Rect(box.x + (box.width - kThumb) / 2, box.y + 3, kThumb, kThumb)));
    image::draw::put_text(image, rows_[i].title, {box.x + box.width / 2, box.br().y + 4},
                          {.height_px = 8, .backing = image::draw::Backing::kNone},
                          image::draw::Anchor::kBottom);
    if (marked_.contains(rows_[i].id)) cv::rectangle(image, box, kMarkedColor, 2);
  }
}

void PeoplePanel::draw(cv::Mat& image, const cv::Rect& max_area) {
  cells_.clear();
  const cv::Rect area = max_area & cv::Rect({0, 0}, image.size());
  if (!is_open() || area.width < 200 || area.height < kTitle + kHint + kRow) return;
  if (list_ != List::kNone) {
    image::draw::fill_rounded(image, area, 8, kBackground, 0.88);
    write(image, fitted(title(), 11, area.width - 16), {area.x + 8, area.y + 5}, 11);
    const cv::Rect inner(area.x + 6, area.y + kTitle, area.width - 12,
                         area.height - kTitle - kHint);
    if (rows_.empty()) {
      const std::string none =
          list_ == List::kGroups ? "none: --keep stores unknown faces" : "none";
      write(image, fitted(none, 10, inner.width - 8), {inner.x + 4, inner.y + 4}, 10, kPale);
    } else {
      try {
        shows_faces() ? draw_faces(image, inner) : draw_rows(image, inner);
      } catch (const InputError& error) {  // a damaged face
        message_ = error.what();
      }
    }
    const std::string keys = hint();
    double height = 9;
    while (height > 6 && image::draw::text_size(keys, height).width > area.width - 12)
      height -= 0.5;
    write(image, fitted(keys, height, area.width - 12), {area.x + 8, area.br().y - kHint + 3},
          height, is_confirming_ ? kMarkedColor : kPale);
  }
  if (!typed_) return;
  const std::string whose =
      list_ == List::kFacesOfPerson
          ? fmt::format("Move {} of {} to which person?",
                        affected_rows().size() == 1 ? "the face" : "the faces", printable(person_))
          : fmt::format("Name of group {}?", group_);
  const cv::Rect box(area.x + 10, area.y + area.height / 2 - 42, area.width - 20, 84);
  image::draw::fill_rounded(image, box, 8, kBackground, 0.95);
  cv::rectangle(image, box, kPale, 1);
  write(image, fitted(whose, 10, box.width - 16), {box.x + 8, box.y + 6}, 10);
  image::draw::put_text(
      image, printable(*typed_) + "_", {box.x + 10, box.y + 28},
      {.height_px = 14, .backing = image::draw::Backing::kBox, .box_opacity = 0.9});
  write(image, "Enter: confirm   Up, Down: names   Esc: cancel", {box.x + 8, box.br().y - 18}, 8,
        kPale);
}

}  // namespace tarsier
