// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <string>
#include <string_view>
#include <vector>

namespace tarsier::cli {

// An image or video of the page.
struct DemoImage {
  std::string file;     // relative to the page, "img/cartoon-home.jpg"
  std::string caption;  // one line; may be empty
  int width = 0;        // px
  int height = 0;
};

// Writes a folder with index.html and its images: one HTML file with embedded style, without
// network access, readable on a phone, light or dark as the reader's system. Text is passed plain
// and escaped here.
class DemoPage {
 public:
  explicit DemoPage(std::string folder);  // created if missing; throws OutputError

  // Writes the image as img/<name>.jpg; drawing() writes .png, for lines and few colours.
  DemoImage image(std::string_view name, const cv::Mat& image, std::string caption = "");
  DemoImage drawing(std::string_view name, const cv::Mat& image, std::string caption = "");
  // The path for another file, "img/<name>", which the caller writes.
  [[nodiscard]] std::string path_of(std::string_view file) const;

  // Parts of the page, in the order of the calls.
  // Also adds an entry to the contents.
  void begin_area(std::string_view title, std::string_view text);
  void heading(std::string_view title, std::string_view text = "");
  void command(std::string_view line);  // as typed by a user
  // Two images with a divider that can be dragged.
  void compare(const DemoImage& before, const DemoImage& after);
  void grid(const std::vector<DemoImage>& images);   // as many side by side as fit
  void strip(const std::vector<DemoImage>& images);  // numbered stages of one image
  void video(const DemoImage& video, const DemoImage& poster);
  // `bars` is the index (from 0) of a column that is also shown as bars, or -1.
  void table(const std::vector<std::string>& columns,
             const std::vector<std::vector<std::string>>& rows, std::string_view caption = "",
             int bars = -1);
  // An interactive page inside the page: complete HTML, trusted.
  void inner_page(std::string_view html, std::string_view title, int height_px);
  void note(std::string_view text);

  // Writes index.html (atomically) and returns its path. `created_by` is a line that says when,
  // where and by what the page was made.
  std::string write(std::string_view title, std::string_view intro,
                    std::string_view created_by) const;

 private:
  DemoImage save_image(std::string_view file, const cv::Mat& image, std::string caption);

  std::string folder_;
  std::string body_;
  std::string contents_;
  int areas_ = 0;
};

}  // namespace tarsier::cli
