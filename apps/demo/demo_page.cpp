// SPDX-License-Identifier: MIT
#include "demo_page.h"

#include "tarsier/core/markup.h"
#include "tarsier/core/require.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include "assets.h"
#include <algorithm>
#include <cstdlib>
#include <filesystem>

namespace tarsier::cli {
namespace {

// An image with its caption, as HTML.
std::string figure(const DemoImage& image) {
  const std::string alt = escaped_markup(image.caption);
  return fmt::format(
             R"(<figure><img src="{}" width="{}" height="{}" alt="{}" loading="lazy">{}</figure>)",
             escaped_markup(image.file), image.width, image.height, alt,
             alt.empty() ? "" : fmt::format("<figcaption>{}</figcaption>", alt)) +
         '\n';
}

std::string paragraph(std::string_view text) {
  return text.empty() ? std::string() : fmt::format("<p>{}</p>\n", escaped_markup(text));
}

}  // namespace

DemoPage::DemoPage(std::string folder) : folder_(std::move(folder)) {
  make_folder((std::filesystem::path(folder_) / "img").string());
}

std::string DemoPage::path_of(std::string_view file) const {
  return (std::filesystem::path(folder_) / "img" / file).string();
}

DemoImage DemoPage::save_image(std::string_view file, const cv::Mat& image, std::string caption) {
  write_image(path_of(file), image, 88);
  return {fmt::format("img/{}", file), std::move(caption), image.cols, image.rows};
}

DemoImage DemoPage::image(std::string_view name, const cv::Mat& image, std::string caption) {
  return save_image(fmt::format("{}.jpg", name), image, std::move(caption));
}

DemoImage DemoPage::drawing(std::string_view name, const cv::Mat& image, std::string caption) {
  return save_image(fmt::format("{}.png", name), image, std::move(caption));
}

void DemoPage::begin_area(std::string_view title, std::string_view text) {
  ++areas_;
  contents_ += fmt::format("<a href=\"#area-{}\">{}</a>\n", areas_, escaped_markup(title));
  body_ +=
      fmt::format("<h2 id=\"area-{}\">{}</h2>\n{}", areas_, escaped_markup(title), paragraph(text));
}

void DemoPage::heading(std::string_view title, std::string_view text) {
  body_ += fmt::format("<h3>{}</h3>\n{}", escaped_markup(title), paragraph(text));
}

void DemoPage::command(std::string_view line) {
  body_ += fmt::format("<pre>{}</pre>\n", escaped_markup(line));
}

void DemoPage::compare(const DemoImage& before, const DemoImage& after) {
  TARSIER_REQUIRE(before.width == after.width && before.height == after.height,
                  "images of two sizes");
  body_ += fmt::format(
      R"html(<figure class="compare"><div class="pair"><img src="{}" width="{}" height="{}" alt="{}">)html"
      R"html(<img class="after" src="{}" width="{}" height="{}" alt="{}"><div class="edge"></div>)html"
      R"html(<input type="range" min="0" max="100" value="50" step="0.5" aria-label="where the line is" )html"
      R"html(oninput="this.closest('.compare').style.setProperty('--at',this.value+'%')"></div>)html"
      R"html(<figcaption>Drag the line: {} | {}</figcaption></figure>)html",
      escaped_markup(before.file), before.width, before.height, escaped_markup(before.caption),
      escaped_markup(after.file), after.width, after.height, escaped_markup(after.caption),
      escaped_markup(before.caption), escaped_markup(after.caption));
  body_ += '\n';
}

void DemoPage::grid(const std::vector<DemoImage>& images) {
  body_ += "<div class=\"grid\">\n";
  for (const DemoImage& image : images) body_ += figure(image);
  body_ += "</div>\n";
}

void DemoPage::strip(const std::vector<DemoImage>& images) {
  body_ += "<div class=\"strip\">\n";
  for (const DemoImage& image : images) body_ += figure(image);
  body_ += "</div>\n";
}

void DemoPage::inner_page(std::string_view html, std::string_view title, int height_px) {
  body_ += fmt::format(
      R"(<iframe srcdoc="{}" title="{}" style="width:100%;height:{}px;border:0;border-radius:10px;margin:12px 0 22px"></iframe>)"
      "\n",
      escaped_markup(html), escaped_markup(title), height_px);
}

void DemoPage::video(const DemoImage& video, const DemoImage& poster) {
  body_ += fmt::format(
      R"(<figure class="video"><video src="{}" poster="{}" width="{}" height="{}" autoplay muted loop playsinline controls></video>)"
      R"(<figcaption>{}</figcaption></figure>)",
      escaped_markup(video.file), escaped_markup(poster.file), video.width, video.height,
      escaped_markup(video.caption));
  body_ += '\n';
}

void DemoPage::table(const std::vector<std::string>& columns,
                     const std::vector<std::vector<std::string>>& rows, std::string_view caption,
                     int bars) {
  double max_value = 0;
  for (const auto& row : rows) {
    TARSIER_REQUIRE(row.size() == columns.size(), "{} cells for {} columns", row.size(),
                    columns.size());
    if (bars >= 0)
      max_value = std::max(max_value, std::atof(row[static_cast<size_t>(bars)].c_str()));
  }
  body_ += "<div class=\"scroll\"><table>";
  if (!caption.empty()) body_ += fmt::format("<caption>{}</caption>", escaped_markup(caption));
  body_ += "<thead><tr>";
  for (const std::string& column : columns)
    body_ += fmt::format("<th scope=\"col\">{}</th>", escaped_markup(column));
  body_ += "</tr></thead>\n<tbody>";
  for (const auto& row : rows) {
    body_ += "<tr>";
    for (size_t i = 0; i < row.size(); ++i) {
      std::string bar;
      if (static_cast<int>(i) == bars && max_value > 0) {
        bar = fmt::format(R"(<span class="bar" style="width:{:.1f}em"></span>)",
                          7 * std::max(0.0, std::atof(row[i].c_str())) / max_value);
      }
      body_ += fmt::format("<td>{}{}</td>", bar, escaped_markup(row[i]));
    }
    body_ += "</tr>\n";
  }
  body_ += "</tbody></table></div>\n";
}

void DemoPage::note(std::string_view text) {
  body_ += fmt::format("<p class=\"note\">{}</p>\n", escaped_markup(text));
}

std::string DemoPage::write(std::string_view title, std::string_view intro,
                            std::string_view created_by) const {
  std::string page = fmt::format(
      R"(<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width,initial-scale=1">
<title>{}</title><style>{}</style></head>
<body><header><div>{}<div><h1>{}</h1><p>{}</p>
<nav aria-label="areas">{}</nav></div></div></header>
<main>
)",
      escaped_markup(title), kDemoCss, kTarsierSvg, escaped_markup(title), escaped_markup(intro),
      contents_);
  page += body_;
  page += fmt::format("</main>\n<footer><div>{}</div></footer></body></html>\n",
                      escaped_markup(created_by));
  const std::string path = (std::filesystem::path(folder_) / "index.html").string();
  write_file_atomically(path, page);
  return path;
}

}  // namespace tarsier::cli
