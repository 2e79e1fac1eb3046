// SPDX-License-Identifier: MIT
#include "tarsier/planar/sheets/page.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <charconv>
#include <filesystem>
#include <string>

namespace tarsier::planar::sheets {
namespace {

using ::testing::HasSubstr;

Page simple() {
  Page page;
  page.size = {100, 50};
  page.fills.push_back({{{10, 10, 20, 20}}, {{{70, 25}, 10}}, 0});
  page.lines.push_back({{10, 45}, {60, 45}, 0.4, 0});
  page.texts.push_back({{10, 8}, 3, "a (b) \\ <c> & \"d\"", 0});
  return page;
}

class PageTest : public FolderTest {};

TEST(PdfTest, CrossReferenceTableIsValid) {
  const std::string pdf = pdf_of({simple(), simple(), simple()}, "three (3)");
  EXPECT_TRUE(pdf.starts_with("%PDF-1.4\n"));
  EXPECT_TRUE(pdf.ends_with("%%EOF\n"));
  const std::size_t at = pdf.find("startxref\n") + 10;
  const std::size_t start = std::stoul(pdf.substr(at));
  ASSERT_EQ(pdf.substr(start, 5), "xref\n");
  const std::size_t count = std::stoul(pdf.substr(start + 7));
  EXPECT_EQ(count, 11U);  // object 0, four for the file, two for each page
  std::size_t entry = pdf.find('\n', start + 5) + 1;
  EXPECT_EQ(pdf.substr(entry, 20), "0000000000 65535 f \n");
  for (std::size_t k = 1; k < count; ++k) {
    const std::string line = pdf.substr(entry + 20 * k, 20);
    EXPECT_EQ(line.substr(10), " 00000 n \n");
    const std::string head = std::to_string(k) + " 0 obj\n";
    EXPECT_EQ(pdf.substr(std::stoul(line), head.size()), head);
  }
  // Each stream has its stated length.
  std::size_t streams = 0;
  for (std::size_t place = pdf.find("/Length "); place != std::string::npos;
       place = pdf.find("/Length ", place + 1)) {
    const std::size_t length = std::stoul(pdf.substr(place + 8));
    const std::size_t begin = pdf.find("stream\n", place) + 7;
    EXPECT_EQ(pdf.substr(begin + length, 9), "endstream");
    ++streams;
  }
  EXPECT_EQ(streams, 3U);
  EXPECT_THAT(pdf, HasSubstr("/MediaBox [ 0 0 283.464567 141.732283 ]"));
  EXPECT_THAT(pdf, HasSubstr("/PrintScaling /None"));
  EXPECT_THAT(pdf, HasSubstr("(a \\(b\\) \\\\ <c> & \"d\") Tj"));
  EXPECT_THAT(pdf, HasSubstr("/Title (three \\(3\\))"));
}

TEST(SvgTest, IsInMillimetres) {
  const std::string svg = svg_of(simple(), "a & b");
  EXPECT_THAT(svg, HasSubstr("width=\"100.0000mm\" height=\"50.0000mm\""));
  EXPECT_THAT(svg, HasSubstr("viewBox=\"0 0 100.0000 50.0000\""));
  EXPECT_THAT(svg, HasSubstr("M10.00000 10.00000h20.00000v20.00000h-20.00000z"));
  EXPECT_THAT(svg, HasSubstr("cx=\"70.00000\""));
  EXPECT_THAT(svg, HasSubstr("a (b) \\ &lt;c&gt; &amp; &quot;d&quot;"));
}

TEST(RasterTest, PixelsAreAreaMeans) {
  Page page;
  page.size = {25.4, 25.4};
  page.fills.push_back({{{5.08, 5.08, 10.16, 10.16}, {15.24, 5.08, 5.08, 10.16}}, {}, 0});
  const cv::Mat even = raster_of(page, 100);  // edges between pixels
  ASSERT_EQ(even.size(), cv::Size(100, 100));
  EXPECT_EQ(even.at<uchar>(19, 50), 255);
  EXPECT_EQ(even.at<uchar>(20, 50), 0);
  EXPECT_EQ(even.at<uchar>(40, 59), 0);  // no line between neighbours
  EXPECT_EQ(even.at<uchar>(40, 60), 0);
  EXPECT_EQ(even.at<uchar>(40, 79), 0);
  EXPECT_EQ(even.at<uchar>(40, 80), 255);
  const cv::Mat odd = raster_of(page, 73);
  const double dark = (255.0 * static_cast<double>(odd.total()) - cv::sum(odd)[0]) / 255;
  EXPECT_NEAR(dark, 73 * 73 * 0.6 * 0.4, 1);
  Page dot;
  dot.size = {25.4, 25.4};
  dot.fills.push_back({{}, {{{12.7, 12.7}, 5.08}}, 0});
  const cv::Mat disk = raster_of(dot, 100);
  EXPECT_NEAR((255.0 * 1e4 - cv::sum(disk)[0]) / 255, CV_PI * 400, 2);
}

TEST_F(PageTest, PngStatesPhysicalSize) {
  const std::string png = png_of(simple(), 300);
  const std::size_t place = png.find("pHYs");
  ASSERT_NE(place, std::string::npos);
  const auto number = [&](std::size_t at) {
    std::uint32_t value = 0;
    for (std::size_t k = 0; k < 4; ++k)
      value = value << 8U | static_cast<std::uint8_t>(png[at + k]);
    return value;
  };
  EXPECT_NEAR(number(place + 4), 300 / 0.0254, 12);  // the page is 1181.1 px wide
  EXPECT_EQ(png[place + 12], 1);
  ASSERT_EQ(write_pages(path("a.png"), {simple()}, "", 300).size(), 1U);
  EXPECT_EQ(read_image(path("a.png")).size(), cv::Size(1181, 591));
}

TEST_F(PageTest, SeveralPagesAreNumbered) {
  EXPECT_THAT(write_pages(path("s.svg"), {simple(), simple()}, "", 100),
              ::testing::ElementsAre(path("s-1.svg"), path("s-2.svg")));
  EXPECT_TRUE(std::filesystem::exists(path("s-2.svg")));
  EXPECT_EQ(write_pages(path("s.PDF"), {simple(), simple()}, "", 100).size(), 1U);
  EXPECT_THROW((void)write_pages(path("s.gif"), {simple()}, "", 100), UsageError);
  EXPECT_THROW((void)write_pages(path("no/s.pdf"), {simple()}, "", 100), OutputError);
}

TEST(PageCheckTest, RejectsInvalidPages) {
  const auto refused = [](const auto& change) {
    Page page = simple();
    change(page);
    EXPECT_THROW((void)pdf_of({page}, ""), std::invalid_argument);
    EXPECT_THROW((void)raster_of(page, 100), std::invalid_argument);
  };
  refused([](Page& p) { p.size.width = 5000; });
  refused([](Page& p) { p.fills[0].boxes[0].width = NAN; });
  refused([](Page& p) { p.fills[0].dots[0].radius = -1; });
  refused([](Page& p) { p.texts[0].text = "\xC3\xA4"; });
  refused([](Page& p) { p.lines[0].to.y = 3; });
  EXPECT_THROW((void)pdf_of({}, ""), std::invalid_argument);
  EXPECT_THROW((void)raster_of(simple(), 10), std::invalid_argument);
  Page large = simple();
  large.size = {2000, 2000};
  EXPECT_THROW((void)raster_of(large, 600), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::planar::sheets
