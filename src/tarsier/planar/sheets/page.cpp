// SPDX-License-Identifier: MIT
#include "tarsier/planar/sheets/page.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/file_extension.h"
#include "tarsier/core/markup.h"
#include "tarsier/core/require.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <iterator>

namespace tarsier::planar::sheets {
namespace {

constexpr double kPointsPerMm = 72 / 25.4;
constexpr double kCapital = 0.718;  // height of a capital letter of Helvetica, in ems
constexpr double kMaxPixels = 2e8;

std::string escaped_pdf(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '(' || c == ')' || c == '\\') result += '\\';
    result += c;
  }
  return result;
}

// A circle as four Bezier curves, with an error of at most 0.03 %; in mm.
void add_dot(std::string& out, const Dot& dot) {
  const double r = dot.radius;
  const double k = 0.5522847498 * r;
  const double x = dot.center.x;
  const double y = dot.center.y;
  fmt::format_to(std::back_inserter(out),
                 "{:.5f} {:.5f} m {:.5f} {:.5f} {:.5f} {:.5f} {:.5f} {:.5f} c "
                 "{:.5f} {:.5f} {:.5f} {:.5f} {:.5f} {:.5f} c "
                 "{:.5f} {:.5f} {:.5f} {:.5f} {:.5f} {:.5f} c "
                 "{:.5f} {:.5f} {:.5f} {:.5f} {:.5f} {:.5f} c h\n",
                 x + r, y, x + r, y + k, x + k, y + r, x, y + r,  //
                 x - k, y + r, x - r, y + k, x - r, y,            //
                 x - r, y - k, x - k, y - r, x, y - r,            //
                 x + k, y - r, x + r, y - k, x + r, y);
}

// The page's content: millimetres, y down.
std::string pdf_content(const Page& page) {
  std::string out = fmt::format("q {0:.9f} 0 0 {1:.9f} 0 {2:.6f} cm\n", kPointsPerMm, -kPointsPerMm,
                                page.size.height * kPointsPerMm);
  for (const Fill& fill : page.fills) {
    fmt::format_to(std::back_inserter(out), "{:.3f} g\n", fill.gray);
    for (const cv::Rect2d& box : fill.boxes) {
      fmt::format_to(std::back_inserter(out), "{:.5f} {:.5f} {:.5f} {:.5f} re\n", box.x, box.y,
                     box.width, box.height);
    }
    for (const Dot& dot : fill.dots) add_dot(out, dot);
    if (!fill.boxes.empty() || !fill.dots.empty()) out += "f\n";
  }
  for (const Line& line : page.lines) {
    fmt::format_to(std::back_inserter(out), "{:.3f} G {:.4f} w {:.5f} {:.5f} m {:.5f} {:.5f} l S\n",
                   line.gray, line.width, line.from.x, line.from.y, line.to.x, line.to.y);
  }
  for (const Text& text : page.texts) {
    fmt::format_to(std::back_inserter(out),
                   "BT {:.3f} g /F1 {:.4f} Tf 1 0 0 -1 {:.5f} {:.5f} Tm ({}) Tj ET\n", text.gray,
                   text.height / kCapital, text.at.x, text.at.y, escaped_pdf(text.text));
  }
  return out + "Q\n";
}

// --- raster ---

// Length of the overlap of [from, to) with pixel k.
double overlap(double from, double to, int k) {
  return std::clamp(std::min(to, k + 1.0) - std::max(from, static_cast<double>(k)), 0.0, 1.0);
}

class Raster {
 public:
  Raster(const cv::Size2d& size, double dpi)
      : coverage_(cvRound(size.height / 25.4 * dpi), cvRound(size.width / 25.4 * dpi), CV_32FC1,
                  cv::Scalar(0)),
        image_(coverage_.size(), CV_8UC1, cv::Scalar(255)),
        x_(coverage_.cols / size.width),
        y_(coverage_.rows / size.height) {}

  // Neighbouring boxes of one fill sum to whole pixels.
  void fill(const Fill& fill) {
    cv::Rect touched;
    for (const cv::Rect2d& box : fill.boxes) touched |= add(box);
    for (const Dot& dot : fill.dots) touched |= add(dot);
    blend(touched, fill.gray);
    // Cleared for the next fill; clearing a whole page would take much longer.
    coverage_(touched).setTo(0);
  }
  void line(const Line& line) {
    const double half = line.width / 2;
    // Along one of the axes: a box (check() ensures this).
    const bool level = line.from.y == line.to.y;
    const cv::Point2d low(std::min(line.from.x, line.to.x), std::min(line.from.y, line.to.y));
    const cv::Point2d high(std::max(line.from.x, line.to.x), std::max(line.from.y, line.to.y));
    const cv::Point2d rim = level ? cv::Point2d(0, half) : cv::Point2d(half, 0);
    fill({{cv::Rect2d(low - rim, high + rim)}, {}, line.gray});
  }
  void text(const Text& text) {
    double height = std::min(text.height * y_, 400.0);
    if (height < 4) return;  // not readable anyway
    // At most as wide as Helvetica: the drawn letters are broader.
    const double most = 0.52 * static_cast<double>(text.text.size()) * height / kCapital;
    const double width = image::draw::text_size(text.text, height).width;
    if (width > most) height = std::max(4.0, height * most / width);
    const double above = 0.5 * (image::draw::text_size(text.text, height).height + height);
    image::draw::TextStyle style;
    style.height_px = height;
    style.color = cv::Scalar::all(255 * text.gray);
    style.backing = image::draw::Backing::kNone;
    image::draw::put_text(image_, text.text,
                          {cvRound(text.at.x * x_), cvRound(text.at.y * y_ - above)}, style,
                          image::draw::Anchor::kTopLeft);
  }
  [[nodiscard]] const cv::Mat& image() const { return image_; }

 private:
  cv::Rect add(const cv::Rect2d& box) {
    const double left = box.x * x_;
    const double right = (box.x + box.width) * x_;
    const double top = box.y * y_;
    const double bottom = (box.y + box.height) * y_;
    const cv::Rect area = inside(left, top, right, bottom);
    for (int y = area.y; y < area.y + area.height; ++y) {
      auto* row = coverage_.ptr<float>(y);
      const double part = overlap(top, bottom, y);
      for (int x = area.x; x < area.x + area.width; ++x)
        row[x] += static_cast<float>(part * overlap(left, right, x));
    }
    return area;
  }
  cv::Rect add(const Dot& dot) {
    constexpr int kSamples = 8;
    const cv::Rect area =
        inside((dot.center.x - dot.radius) * x_, (dot.center.y - dot.radius) * y_,
               (dot.center.x + dot.radius) * x_, (dot.center.y + dot.radius) * y_);
    for (int y = area.y; y < area.y + area.height; ++y) {
      auto* row = coverage_.ptr<float>(y);
      for (int x = area.x; x < area.x + area.width; ++x) {
        int hits = 0;
        for (int s = 0; s < kSamples * kSamples; ++s) {
          const double u = (x + (s % kSamples + 0.5) / kSamples) / x_ - dot.center.x;
          const double v = (y + (s / kSamples + 0.5) / kSamples) / y_ - dot.center.y;
          if (u * u + v * v <= dot.radius * dot.radius) ++hits;
        }
        row[x] += static_cast<float>(hits) / (kSamples * kSamples);
      }
    }
    return area;
  }
  [[nodiscard]] cv::Rect inside(double left, double top, double right, double bottom) const {
    return cv::Rect(cv::Point(cvFloor(left), cvFloor(top)),
                    cv::Point(cvCeil(right), cvCeil(bottom))) &
           cv::Rect(0, 0, coverage_.cols, coverage_.rows);
  }
  void blend(const cv::Rect& area, double gray) {
    for (int y = area.y; y < area.y + area.height; ++y) {
      const auto* part = coverage_.ptr<float>(y);
      auto* out = image_.ptr<uchar>(y);
      for (int x = area.x; x < area.x + area.width; ++x) {
        const double share = std::min(1.0, static_cast<double>(part[x]));
        out[x] = cv::saturate_cast<uchar>((1 - share) * out[x] + share * 255 * gray);
      }
    }
  }

  cv::Mat coverage_;
  cv::Mat image_;
  double x_;  // px per mm
  double y_;
};

// --- PNG chunks ---

std::uint32_t crc_of(const std::string& bytes) {
  std::uint32_t crc = 0xFFFFFFFFU;
  for (const char c : bytes) {
    crc ^= static_cast<std::uint8_t>(c);
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1U) ^ ((crc & 1U) != 0 ? 0xEDB88320U : 0U);
  }
  return ~crc;
}

std::string big_endian(std::uint32_t value) {
  std::string bytes;
  for (const unsigned shift : {24U, 16U, 8U, 0U})
    bytes += static_cast<char>((value >> shift) & 0xFFU);
  return bytes;
}

// Inserts a resolution chunk after the header chunk of 25 bytes, which is always the first.
std::string with_resolution(const std::string& png, double per_meter_x, double per_meter_y) {
  constexpr std::size_t kAfterHeader = 8 + 25;
  const std::string data = "pHYs" +
                           big_endian(static_cast<std::uint32_t>(std::lround(per_meter_x))) +
                           big_endian(static_cast<std::uint32_t>(std::lround(per_meter_y))) + '\1';
  return png.substr(0, kAfterHeader) + big_endian(9) + data + big_endian(crc_of(data)) +
         png.substr(kAfterHeader);
}

}  // namespace

void Page::check() const {
  TARSIER_REQUIRE(
      size.width >= 10 && size.width <= 2000 && size.height >= 10 && size.height <= 2000,
      "a page of {}x{} mm", size.width, size.height);
  for (const Fill& fill : fills) {
    for (const cv::Rect2d& box : fill.boxes) {
      TARSIER_REQUIRE(std::isfinite(box.x) && std::isfinite(box.y) && box.width > 0 &&
                          box.height > 0 && std::isfinite(box.width) && std::isfinite(box.height),
                      "a box of {}x{} mm", box.width, box.height);
    }
    for (const Dot& dot : fill.dots) {
      TARSIER_REQUIRE(std::isfinite(dot.center.x) && std::isfinite(dot.center.y) &&
                          dot.radius > 0 && std::isfinite(dot.radius),
                      "a dot of {} mm", dot.radius);
    }
  }
  for (const Line& line : lines) {
    TARSIER_REQUIRE(line.from.x == line.to.x || line.from.y == line.to.y, "a line of {} mm",
                    cv::norm(line.to - line.from));
  }
  for (const Text& text : texts) {
    TARSIER_REQUIRE(std::all_of(text.text.begin(), text.text.end(),
                                [](char c) { return c >= ' ' && c <= '~'; }),
                    "text that is not plain");
  }
}

std::string pdf_of(const std::vector<Page>& pages, const std::string& title) {
  TARSIER_REQUIRE(!pages.empty(), "{} pages", pages.size());
  std::vector<std::string> objects;  // number k + 1
  const auto page_number = [](std::size_t k) { return 5 + 2 * k; };
  std::string kids;
  for (std::size_t k = 0; k < pages.size(); ++k) kids += fmt::format("{} 0 R ", page_number(k));
  objects.emplace_back(
      "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>");
  objects.push_back(fmt::format("<< /Type /Pages /Kids [ {}] /Count {} >>", kids, pages.size()));
  objects.emplace_back(
      "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>");
  objects.push_back(fmt::format("<< /Title ({}) /Producer (Tarsier) >>", escaped_pdf(title)));
  for (std::size_t k = 0; k < pages.size(); ++k) {
    pages[k].check();
    const std::string content = pdf_content(pages[k]);
    objects.push_back(
        fmt::format("<< /Type /Page /Parent 2 0 R /MediaBox [ 0 0 {:.6f} {:.6f} ] /Resources << "
                    "/Font << /F1 3 0 R >> >> /Contents {} 0 R >>",
                    pages[k].size.width * kPointsPerMm, pages[k].size.height * kPointsPerMm,
                    page_number(k) + 1));
    objects.push_back(
        fmt::format("<< /Length {} >>\nstream\n{}endstream", content.size(), content));
  }
  std::string out = "%PDF-1.4\n%\xE2\xE3\xCF\xD3\n";
  std::string table = fmt::format("xref\n0 {}\n0000000000 65535 f \n", objects.size() + 1);
  for (std::size_t k = 0; k < objects.size(); ++k) {
    fmt::format_to(std::back_inserter(table), "{:010} 00000 n \n", out.size());
    fmt::format_to(std::back_inserter(out), "{} 0 obj\n{}\nendobj\n", k + 1, objects[k]);
  }
  const std::size_t start = out.size();
  return out + table +
         fmt::format("trailer\n<< /Size {} /Root 1 0 R /Info 4 0 R >>\nstartxref\n{}\n%%EOF\n",
                     objects.size() + 1, start);
}

std::string svg_of(const Page& page, const std::string& title) {
  page.check();
  const auto color = [](double gray) {
    const int level = cvRound(255 * gray);
    return fmt::format("#{0:02x}{0:02x}{0:02x}", level);
  };
  std::string out = fmt::format(
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.4f}mm\" height=\"{1:.4f}mm\" "
      "viewBox=\"0 0 {0:.4f} {1:.4f}\">\n<title>{2}</title>\n"
      "<rect width=\"{0:.4f}\" height=\"{1:.4f}\" fill=\"#ffffff\"/>\n",
      page.size.width, page.size.height, escaped_markup(title));
  for (const Fill& fill : page.fills) {
    if (!fill.boxes.empty()) {
      fmt::format_to(std::back_inserter(out), "<path fill=\"{}\" d=\"", color(fill.gray));
      for (const cv::Rect2d& b : fill.boxes) {
        fmt::format_to(std::back_inserter(out), "M{:.5f} {:.5f}h{:.5f}v{:.5f}h{:.5f}z", b.x, b.y,
                       b.width, b.height, -b.width);
      }
      out += "\"/>\n";
    }
    for (const Dot& dot : fill.dots) {
      fmt::format_to(std::back_inserter(out),
                     "<circle cx=\"{:.5f}\" cy=\"{:.5f}\" r=\"{:.5f}\" fill=\"{}\"/>\n",
                     dot.center.x, dot.center.y, dot.radius, color(fill.gray));
    }
  }
  for (const Line& line : page.lines) {
    fmt::format_to(std::back_inserter(out),
                   "<path stroke=\"{}\" stroke-width=\"{:.4f}\" d=\"M{:.5f} {:.5f}L{:.5f} "
                   "{:.5f}\"/>\n",
                   color(line.gray), line.width, line.from.x, line.from.y, line.to.x, line.to.y);
  }
  for (const Text& text : page.texts) {
    fmt::format_to(std::back_inserter(out),
                   "<text x=\"{:.4f}\" y=\"{:.4f}\" font-family=\"Helvetica, Arial, sans-serif\" "
                   "font-size=\"{:.4f}\" fill=\"{}\">{}</text>\n",
                   text.at.x, text.at.y, text.height / kCapital, color(text.gray),
                   escaped_markup(text.text));
  }
  return out + "</svg>\n";
}

cv::Mat raster_of(const Page& page, double dpi) {
  page.check();
  TARSIER_REQUIRE(dpi >= 36 && dpi <= 2400, "{} dpi", dpi);
  const double pixels = page.size.area() / (25.4 * 25.4) * dpi * dpi;
  TARSIER_REQUIRE(pixels <= kMaxPixels, "{:.0f} million pixels", pixels / 1e6);
  Raster raster(page.size, dpi);
  for (const Fill& fill : page.fills) raster.fill(fill);
  for (const Line& line : page.lines) raster.line(line);
  for (const Text& text : page.texts) raster.text(text);
  return raster.image();
}

std::string png_of(const Page& page, double dpi) {
  const cv::Mat image = raster_of(page, dpi);
  const std::vector<std::uint8_t> bytes = encode_image(".png", image, "sheet.png");
  return with_resolution(std::string(bytes.begin(), bytes.end()),
                         image.cols / page.size.width * 1e3, image.rows / page.size.height * 1e3);
}

std::vector<std::string> write_pages(const std::string& path, const std::vector<Page>& pages,
                                     const std::string& title, double dpi) {
  namespace fs = std::filesystem;
  const fs::path file(path);
  const std::string ending = lowercase_extension(path);
  if (ending == ".pdf") {
    write_file_atomically(path, pdf_of(pages, title));
    return {path};
  }
  if (ending != ".svg" && ending != ".png") {
    throw UsageError(fmt::format("{}: .pdf, .svg or .png is written", path));
  }
  std::vector<std::string> paths;
  for (std::size_t k = 0; k < pages.size(); ++k) {
    fs::path numbered = file;
    if (pages.size() > 1) {
      numbered.replace_filename(
          fmt::format("{}-{}{}", file.stem().string(), k + 1, file.extension().string()));
    }
    paths.push_back(numbered.string());
    write_file_atomically(paths.back(),
                          ending == ".svg" ? svg_of(pages[k], title) : png_of(pages[k], dpi));
  }
  return paths;
}

}  // namespace tarsier::planar::sheets
