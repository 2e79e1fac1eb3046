// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <string>
#include <string_view>
#include <vector>

namespace tarsier::cli {

// An image or video beside the page.
struct DemoImage {
  std::string file;     // relative to the page, "img/cartoon-home.jpg"
  std::string caption;  // one line; may be empty
  int width = 0;        // px
  int height = 0;
};

// Writes a folder with index.html and the images it shows: one file of HTML with its style
// inside, no network, readable on a phone, light or dark as the reader's system is. Text is given
// plain and escaped here.
class DemoPage {
 public:
  explicit DemoPage(std::string folder);  // made if missing; throws OutputError

  // Writes the image as img/<name>.jpg (or .png where lines or few colours would suffer).
  DemoImage image(std::string_view name, const cv::Mat& image, std::string caption = "");
  DemoImage drawing(std::string_view name, const cv::Mat& image, std::string caption = "");
  // The path for a file of another kind, "img/<name>", which the caller writes.
  [[nodiscard]] std::string path_of(std::string_view file) const;

  // The page's parts, in the order of the calls.
  void begin_area(std::string_view title, std::string_view text);  // with an entry in the contents
  void heading(std::string_view title, std::string_view text = "");
  void command(std::string_view line);  // what a user would type
  void compare(const DemoImage& before,
               const DemoImage& after);              // with a line to drag between them
  void grid(const std::vector<DemoImage>& images);   // as many beside each other as fit
  void strip(const std::vector<DemoImage>& images);  // numbered stages of one image
  void video(const DemoImage& video, const DemoImage& poster);
  // `bars` is the number of a column (from 0) that is also shown as bars, or -1.
  void table(const std::vector<std::string>& columns,
             const std::vector<std::vector<std::string>>& rows, std::string_view caption = "",
             int bars = -1);
  // A page within the page, which can be handled: whole HTML, trusted.
  void inner_page(std::string_view html, std::string_view title, int height_px);
  void note(std::string_view text);

  // Writes index.html (atomically) and returns its path. `made` is a line on when, where and by
  // what.
  std::string write(std::string_view title, std::string_view intro, std::string_view made) const;

 private:
  DemoImage save_image(std::string_view file, const cv::Mat& image, std::string caption);

  std::string folder_;
  std::string body_;
  std::string contents_;
  int areas_ = 0;
};

}  // namespace tarsier::cli
