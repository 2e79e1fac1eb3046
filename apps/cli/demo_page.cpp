// SPDX-License-Identifier: MIT
#include "demo_page.h"

#include "tarsier/core/markup.h"
#include "tarsier/core/require.h"
#include "tarsier/io/atomic_file.h"
#include "tarsier/io/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>

namespace tarsier::cli {
namespace {

constexpr std::string_view kStyle = R"css(
:root{color-scheme:light dark;--ink:#1d2330;--dim:#5c6474;--paper:#faf8f3;--card:#fff;--line:#e3ded2;
--accent:#b4541a;--code:#f1ede3;--bar:#e8b48f}
@media(prefers-color-scheme:dark){:root{--ink:#e9e6df;--dim:#a3a7b0;--paper:#14171c;--card:#1c2027;--line:#2e343e;
--accent:#f0a060;--code:#10131a;--bar:#7a4a24}}
*{box-sizing:border-box}
html{scroll-behavior:smooth;-webkit-text-size-adjust:100%}
body{margin:0;background:var(--paper);color:var(--ink);font:17px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,
"Noto Sans",sans-serif}
main,header>div,footer>div{max-width:1120px;margin:0 auto;padding:0 20px}
header{border-bottom:1px solid var(--line);padding:40px 0 24px}
header>div{display:flex;gap:22px;align-items:center}
header svg{width:92px;height:92px;flex:none}
h1{font-size:2.1rem;line-height:1.15;margin:0 0 6px;letter-spacing:-.01em}
header p{margin:0;color:var(--dim);max-width:64ch}
nav{display:flex;flex-wrap:wrap;gap:8px;margin:14px 0 0}
nav a{border:1px solid var(--line);border-radius:99px;padding:3px 14px;color:var(--accent);text-decoration:none;
background:var(--card)}
nav a:hover,nav a:focus{border-color:var(--accent)}
h2{font-size:1.6rem;margin:52px 0 4px;letter-spacing:-.01em}
h3{font-size:1.15rem;margin:38px 0 4px}
p{margin:6px 0 14px;max-width:72ch}
pre{background:var(--code);border:1px solid var(--line);border-radius:8px;padding:10px 14px;overflow-x:auto;
font:14px/1.5 ui-monospace,SFMono-Regular,Menlo,Consolas,"DejaVu Sans Mono",monospace;margin:10px 0 16px}
pre::before{content:"$ ";color:var(--accent)}
figure{margin:0;background:var(--card);border:1px solid var(--line);border-radius:10px;overflow:hidden}
figure img,figure video{display:block;width:100%;height:auto}
figcaption{padding:6px 11px 8px;font-size:.86rem;color:var(--dim);line-height:1.35}
.grid{display:grid;grid-template-columns:repeat(auto-fill,minmax(300px,1fr));gap:14px;margin:12px 0 20px;align-items:start}
.strip{display:grid;grid-template-columns:repeat(auto-fill,minmax(200px,1fr));gap:12px;margin:12px 0 20px;
counter-reset:stage;align-items:start}
.strip figcaption::before{counter-increment:stage;content:counter(stage) ". ";color:var(--accent);font-weight:600}
.compare{position:relative;max-width:860px;margin:14px 0 22px;--at:50%;touch-action:pan-y}
.compare .pair{position:relative;display:grid}
.compare .pair>*{grid-area:1/1}
.compare .pair img{width:100%}
.compare .after{clip-path:inset(0 0 0 var(--at))}
.compare .edge{position:absolute;top:0;bottom:0;left:var(--at);width:3px;margin-left:-1px;background:#fff;
box-shadow:0 0 6px #0008;pointer-events:none}
.compare .edge::after{content:"\2194";position:absolute;top:50%;left:50%;transform:translate(-50%,-50%);width:38px;
height:38px;line-height:36px;text-align:center;border-radius:50%;background:#fff;color:#222;font-size:20px;
box-shadow:0 1px 6px #0007}
.compare input{width:100%;height:100%;margin:0;opacity:0;cursor:ew-resize;z-index:1}
.compare:focus-within{outline:2px solid var(--accent);outline-offset:2px}
.film{max-width:860px}
.scroll{overflow-x:auto;margin:10px 0 18px;border:1px solid var(--line);border-radius:10px;background:var(--card)}
table{border-collapse:collapse;width:100%;font-size:.94rem;font-variant-numeric:tabular-nums}
caption{caption-side:bottom;text-align:left;padding:8px 12px;color:var(--dim);font-size:.86rem;
border-top:1px solid var(--line)}
th,td{text-align:right;padding:7px 12px;white-space:nowrap}
th:first-child,td:first-child{text-align:left}
th{color:var(--dim);font-weight:600;border-bottom:1px solid var(--line)}
tr+tr td{border-top:1px solid var(--line)}
td .bar{display:inline-block;height:.8em;background:var(--bar);border-radius:3px;margin-right:8px;
vertical-align:-.05em}
.note{border-left:3px solid var(--accent);padding:2px 0 2px 14px;color:var(--dim)}
footer{border-top:1px solid var(--line);margin-top:56px;padding:18px 0 40px;color:var(--dim);font-size:.86rem}
@media(max-width:560px){body{font-size:16px}header{padding:24px 0 18px}header svg{width:60px;height:60px}
h1{font-size:1.6rem}h2{font-size:1.35rem;margin-top:40px}main,header>div,footer>div{padding:0 14px}
.grid{grid-template-columns:1fr 1fr;gap:8px}.strip{grid-template-columns:1fr 1fr;gap:8px}
figcaption{font-size:.78rem;padding:5px 8px 7px}th,td{padding:6px 9px}}
)css";

// A tarsier: a very small animal with very large eyes.
constexpr std::string_view kMark = R"svg(<svg viewBox="0 0 96 96" role="img" aria-label="a tarsier">
<path d="M13 30C2 16 10 3 20 9c7 4 11 10 12 16zM83 30c11-14 3-27-7-21-7 4-11 10-12 16z" fill="#8a5a34"/>
<path d="M17 25c-5-8-2-14 3-11 4 2 6 6 7 9zM79 25c5-8 2-14-3-11-4 2-6 6-7 9z" fill="#d9a27c"/>
<ellipse cx="48" cy="50" rx="38" ry="34" fill="#a9713f"/><path d="M48 22c5 9 5 22 0 34-5-12-5-25 0-34z" fill="#e6c39b"/>
<ellipse cx="48" cy="72" rx="15" ry="10" fill="#e6c39b"/>
<circle cx="29" cy="47" r="19" fill="#3b2412"/><circle cx="67" cy="47" r="19" fill="#3b2412"/>
<circle cx="29" cy="47" r="17" fill="#e79a2c"/><circle cx="67" cy="47" r="17" fill="#e79a2c"/>
<circle cx="30" cy="47" r="8" fill="#14100c"/><circle cx="66" cy="47" r="8" fill="#14100c"/>
<circle cx="27" cy="43" r="3.2" fill="#fff"/><circle cx="63" cy="43" r="3.2" fill="#fff"/>
<path d="M44 67h8l-4 4z" fill="#3b2412"/><path d="M38 75q10 6 20 0" fill="none" stroke="#3b2412" stroke-width="2"
stroke-linecap="round"/></svg>)svg";

std::string figure(const DemoPicture& picture) {
  const std::string alt = escaped_markup(picture.caption);
  return fmt::format(
             R"(<figure><img src="{}" width="{}" height="{}" alt="{}" loading="lazy">{}</figure>)",
             escaped_markup(picture.file), picture.width, picture.height, alt,
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

DemoPicture DemoPage::write_picture(std::string_view file, const cv::Mat& image,
                                    std::string caption) {
  write_image(path_of(file), image, 88);
  return {fmt::format("img/{}", file), std::move(caption), image.cols, image.rows};
}

DemoPicture DemoPage::picture(std::string_view name, const cv::Mat& image, std::string caption) {
  return write_picture(fmt::format("{}.jpg", name), image, std::move(caption));
}

DemoPicture DemoPage::drawing(std::string_view name, const cv::Mat& image, std::string caption) {
  return write_picture(fmt::format("{}.png", name), image, std::move(caption));
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

void DemoPage::compare(const DemoPicture& before, const DemoPicture& after) {
  TARSIER_REQUIRE(before.width == after.width && before.height == after.height,
                  "pictures of two sizes");
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

void DemoPage::grid(const std::vector<DemoPicture>& pictures) {
  body_ += "<div class=\"grid\">\n";
  for (const DemoPicture& picture : pictures) body_ += figure(picture);
  body_ += "</div>\n";
}

void DemoPage::strip(const std::vector<DemoPicture>& pictures) {
  body_ += "<div class=\"strip\">\n";
  for (const DemoPicture& picture : pictures) body_ += figure(picture);
  body_ += "</div>\n";
}

void DemoPage::inner_page(std::string_view html, std::string_view title, int height_px) {
  body_ += fmt::format(
      R"(<iframe srcdoc="{}" title="{}" style="width:100%;height:{}px;border:0;border-radius:10px;margin:12px 0 22px"></iframe>)"
      "\n",
      escaped_markup(html), escaped_markup(title), height_px);
}

void DemoPage::film(const DemoPicture& film, const DemoPicture& poster) {
  body_ += fmt::format(
      R"(<figure class="film"><video src="{}" poster="{}" width="{}" height="{}" autoplay muted loop playsinline controls></video>)"
      R"(<figcaption>{}</figcaption></figure>)",
      escaped_markup(film.file), escaped_markup(poster.file), film.width, film.height,
      escaped_markup(film.caption));
  body_ += '\n';
}

void DemoPage::table(const std::vector<std::string>& columns,
                     const std::vector<std::vector<std::string>>& rows, std::string_view caption,
                     int bars) {
  double most = 0;
  for (const auto& row : rows) {
    TARSIER_REQUIRE(row.size() == columns.size(), "{} cells for {} columns", row.size(),
                    columns.size());
    if (bars >= 0) most = std::max(most, std::atof(row[static_cast<size_t>(bars)].c_str()));
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
      if (static_cast<int>(i) == bars && most > 0) {
        bar = fmt::format(R"(<span class="bar" style="width:{:.1f}em"></span>)",
                          7 * std::max(0.0, std::atof(row[i].c_str())) / most);
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
                            std::string_view made) const {
  std::string page = fmt::format(
      R"(<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width,initial-scale=1">
<title>{}</title><style>{}</style></head>
<body><header><div>{}<div><h1>{}</h1><p>{}</p>
<nav aria-label="areas">{}</nav></div></div></header>
<main>
)",
      escaped_markup(title), kStyle, kMark, escaped_markup(title), escaped_markup(intro),
      contents_);
  page += body_;
  page +=
      fmt::format("</main>\n<footer><div>{}</div></footer></body></html>\n", escaped_markup(made));
  const std::string path = (std::filesystem::path(folder_) / "index.html").string();
  write_file_atomically(path, page);
  return path;
}

}  // namespace tarsier::cli
