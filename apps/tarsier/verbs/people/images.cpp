// SPDX-License-Identifier: MIT
#include "verbs/people/images.h"

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/log.h"
#include "tarsier/face/recognition/normalize.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/image/draw/tile.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

class StageRecorder final : public DebugSink {
 public:
  void image(std::string_view name, const cv::Mat& image) override {
    images.add(std::string(name), image);
  }
  NamedImages images;
};

constexpr std::size_t kMaxSheetFaces = 800;  // max faces: larger images are of no use
constexpr int kSheetColumns = 8;
const cv::Size kSheetFace(128, 160);  // px
constexpr int kSheetLabel = 24;       // px, below a face
const cv::Scalar kSheetGray(32, 32, 32);

// The top-left corner of a cell of a FaceSheet.
cv::Point sheet_corner(std::size_t index) {
  const int i = static_cast<int>(index);
  return {i % kSheetColumns * kSheetFace.width,
          i / kSheetColumns * (kSheetFace.height + kSheetLabel)};
}

double score_of(const face::recognition::Recognizer& model, const cv::Mat& input, int person) {
  for (const auto& one : face::recognition::identify(model, input))
    if (one.person == person) return one.score;
  return 0;
}

}  // namespace

NamedImages face_stages(face::people::FaceReader& reader, const cv::Mat& gray) {
  StageRecorder recorder;
  if (reader.read(gray, &recorder).empty()) return {};
  // Shows the face, not the whole of a large image.
  for (std::size_t i = 0; i < recorder.images.names.size(); ++i) {
    if (recorder.images.names[i] != "found") continue;
    const auto faces = reader.read(gray);
    const cv::Rect2d& box = faces.front().box;
    const cv::Rect around =
        cv::Rect(cvRound(box.x - 0.5 * box.width), cvRound(box.y - 0.4 * box.height),
                 cvRound(2 * box.width), cvRound(1.9 * box.height)) &
        cv::Rect(0, 0, gray.cols, gray.rows);
    cv::Mat enlarged;
    const double zoom = std::clamp(300.0 / std::max(1, around.width), 0.1, 4.0);
    cv::resize(recorder.images.images[i](around), enlarged, {}, zoom, zoom,
               zoom < 1 ? cv::INTER_AREA : cv::INTER_CUBIC);
    recorder.images.images[i] = enlarged;
  }
  return recorder.images;
}

cv::Mat evidence_image(const face::recognition::Recognizer& model, const cv::Mat& input,
                       int person) {
  constexpr int kColumns = 8;
  constexpr int kRows = 10;
  const double whole = score_of(model, input, person);
  cv::Mat blurred;
  cv::GaussianBlur(input, blurred, {}, input.cols / 8.0);
  cv::Mat loss(kRows, kColumns, CV_32FC1);
  for (int y = 0; y < kRows; ++y) {
    for (int x = 0; x < kColumns; ++x) {
      // The blur has soft edges, since a hard edge would be a feature itself.
      cv::Mat weight = cv::Mat::zeros(input.size(), CV_32FC1);
      const cv::Point center(cvRound((x + 0.5) * input.cols / kColumns),
                             cvRound((y + 0.5) * input.rows / kRows));
      cv::circle(weight, center, input.cols / 8, cv::Scalar(1), cv::FILLED);
      cv::GaussianBlur(weight, weight, {}, input.cols / 24.0);
      cv::Mat mixed(input.size(), CV_8UC1);
      for (int v = 0; v < input.rows; ++v) {
        for (int u = 0; u < input.cols; ++u) {
          const float w = weight.at<float>(v, u);
          mixed.at<unsigned char>(v, u) = cv::saturate_cast<unsigned char>(
              (1 - w) * static_cast<float>(input.at<unsigned char>(v, u)) +
              w * static_cast<float>(blurred.at<unsigned char>(v, u)));
        }
      }
      loss.at<float>(y, x) = static_cast<float>(whole - score_of(model, mixed, person));
    }
  }
  double low = 0;
  double high = 0;
  cv::minMaxLoc(loss, &low, &high);
  const double max_loss = std::max({std::abs(low), std::abs(high), 1e-9});
  cv::Mat smooth;
  cv::resize(loss, smooth, input.size(), 0, 0, cv::INTER_CUBIC);
  cv::Mat out(input.size(), CV_8UC3);
  for (int v = 0; v < input.rows; ++v) {
    for (int u = 0; u < input.cols; ++u) {
      const double share = std::clamp(smooth.at<float>(v, u) / max_loss, -1.0, 1.0);
      const double gray = 0.55 * input.at<unsigned char>(v, u);
      out.at<cv::Vec3b>(v, u) = {
          cv::saturate_cast<unsigned char>(gray + 110 * std::max(0.0, -share)),
          cv::saturate_cast<unsigned char>(gray),
          cv::saturate_cast<unsigned char>(gray + 110 * std::max(0.0, share))};
    }
  }
  return out;
}

void FaceSheet::add(const cv::Mat& crop, std::int64_t number, nlohmann::ordered_json& line) {
  if (!is_drawn()) return;
  if (cells_.size() == kMaxSheetFaces) {
    ++left_out_;
    return;
  }
  cv::Mat cell(kSheetFace.height + kSheetLabel, kSheetFace.width, CV_8UC3, kSheetGray);
  if (!crop.empty()) {
    image::draw::letterbox(crop, kSheetFace, kSheetGray).copyTo(cell(cv::Rect({0, 0}, kSheetFace)));
  }
  image::draw::put_text(cell, fmt::format("{}", number), {6, kSheetFace.height + 5},
                        {.height_px = 11});
  const cv::Point at = sheet_corner(cells_.size());
  line["box"] = {at.x, at.y, kSheetFace.width, kSheetFace.height};
  cells_.push_back(cell);
}

void FaceSheet::write() const {
  if (!is_drawn() || cells_.empty()) return;
  if (left_out_ > 0)
    log_warning("the first {} faces are drawn, {} are not", kMaxSheetFaces, left_out_);
  const auto columns = static_cast<int>(std::min<std::size_t>(cells_.size(), kSheetColumns));
  cv::Mat sheet(sheet_corner(cells_.size() - 1).y + cells_.front().rows, columns * kSheetFace.width,
                CV_8UC3, kSheetGray);
  for (std::size_t i = 0; i < cells_.size(); ++i)
    cells_[i].copyTo(sheet(cv::Rect(sheet_corner(i), cells_[i].size())));
  write_image(path_, sheet);
}

}  // namespace tarsier::cli
