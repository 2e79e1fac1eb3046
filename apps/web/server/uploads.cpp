// SPDX-License-Identifier: MIT
// Which uploads are accepted, and the type that is reported.
#include "tarsier/core/name_table.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/image_probe.h"

#include <fmt/format.h>

#include "workspace.h"
#include "workspace_paths.h"
#include <algorithm>
#include <array>
#include <cctype>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

namespace tarsier::web {
namespace {

constexpr NameTable<FileType, 3> kFileTypes{
    "kind of file",
    {{{FileType::kImage, "image"}, {FileType::kVideo, "video"}, {FileType::kOther, "other"}}}};

constexpr auto kVideoExtensions =
    std::to_array<std::string_view>({".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm"});
// Other files that verbs read, besides images and videos.
constexpr auto kDataExtensions =
    std::to_array<std::string_view>({".txt", ".csv", ".json", ".jsonl", ".yaml", ".yml", ".xml",
                                     ".pts", ".asf", ".obj", ".ply", ".tri"});

bool has_extension(std::string_view name, const auto& extensions) {
  std::string lower(name);
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return std::any_of(extensions.begin(), extensions.end(),
                     [&](std::string_view extension) { return lower.ends_with(extension); });
}

bool is_video_head(std::string_view bytes) {
  const bool is_mp4 = bytes.size() >= 12 && bytes.substr(4, 4) == "ftyp";
  const bool is_avi =
      bytes.size() >= 12 && bytes.starts_with("RIFF") && bytes.substr(8, 4) == "AVI ";
  const bool is_matroska = bytes.starts_with("\x1a\x45\xdf\xa3");
  return is_mp4 || is_avi || is_matroska;
}

// Verbs open the files named in lists and sets; none may be outside their folder. Words longer than
// any path are numbers and encoded bytes.
bool names_foreign_files(std::string_view text) {
  constexpr std::size_t kLongestPath = 4096;
  const auto is_break = [](char c) {
    return std::isspace(static_cast<unsigned char>(c)) != 0 || c == '"' || c == '\'' || c == ',' ||
           c == ';' || c == '>' || c == '=' || c == '[' || c == '(' || c == '\0';
  };
  for (std::size_t n = 0; n < text.size(); ++n) {
    if (text[n] == '\\' && n + 1 < text.size() && text[n + 1] == '/') return true;  // JSON's "\/"
    if (text[n] == '\\' && text.substr(n + 1, 5) == "u002f") return true;
    if (text[n] == '\\' && text.substr(n + 1, 5) == "u002F") return true;
    if (text[n] == '\\' && text.substr(n + 1, 5) == "u002e") return true;
    if (text[n] == '\\' && text.substr(n + 1, 5) == "u002E") return true;
    if (text[n] == '&' && n + 1 < text.size() && text[n + 1] == '#') return true;  // XML's &#47;
    if (text[n] == '.' && text.substr(n, 3) == "../") return true;
    const bool begins = n == 0 || is_break(text[n - 1]);
    if (!begins || (text[n] != '/' && text[n] != '~')) continue;
    std::size_t end = n + 1;
    while (end < text.size() && end - n <= kLongestPath && !is_break(text[end])) ++end;
    if (end - n > 1 && end - n <= kLongestPath) return true;
  }
  return false;
}

}  // namespace

bool is_video(std::string_view name, std::string_view head) {
  return has_extension(name, kVideoExtensions) && is_video_head(head);
}

std::string_view name_of(FileType type) { return kFileTypes.name(type); }

nlohmann::json to_json(const FileInfo& file) {
  nlohmann::json json = {{"name", file.name},
                         {"bytes", file.bytes},
                         {"kind", name_of(file.type)},
                         {"modified", file.modified}};
  if (file.type == FileType::kImage) {
    json["width"] = file.width;
    json["height"] = file.height;
  }
  return json;
}

std::string upload_error(std::string_view name, std::string_view bytes, std::int64_t max_pixels,
                         FileType& type) {
  type = FileType::kOther;
  if (bytes.empty()) return "the file is empty";
  if (const auto format = image_format_of(bytes_of(bytes))) {
    type = FileType::kImage;
    if (*format == ImageFormat::kTiff)
      return "TIFF is not supported; save the image as PNG or JPEG";
    const auto header = probe_image(bytes_of(bytes));
    if (!header) return "the image is truncated or damaged";
    const std::int64_t pixels = static_cast<std::int64_t>(header->width) * header->height;
    if (pixels <= 0 || pixels > max_pixels) {
      return fmt::format("the image has {}x{} px; at most {} million are accepted", header->width,
                         header->height, max_pixels / 1'000'000);
    }
    std::vector<std::uint8_t> kept;
    if (std::string damage = find_image_damage(bytes_of(bytes), *header, kept); !damage.empty()) {
      return "the image is damaged: " + damage;
    }
    return {};
  }
  if (has_extension(name, kVideoExtensions)) {
    type = FileType::kVideo;
    return is_video_head(bytes) ? "" : "the file is named like a video, but is not one";
  }
  if (has_extension(name, kDataExtensions)) {
    if (!names_foreign_files(bytes)) return {};
    return "the file refers to others by absolute paths or '..'; use their names only, and upload "
           "them into the same set";
  }
  return fmt::format(
      "{}; accepted are images (JPEG, PNG, WebP, BMP, PNM), videos (MP4, AVI, MKV) and "
      "data (.txt .csv .json .jsonl .yaml .xml .pts .asf .obj .ply)",
      describe_not_an_image(bytes_of(bytes)));
}

std::string media_type(std::string_view name) {
  constexpr auto kTypes = std::to_array<std::pair<std::string_view, std::string_view>>({
      {".jpg", "image/jpeg"},
      {".jpeg", "image/jpeg"},
      {".png", "image/png"},
      {".webp", "image/webp"},
      {".bmp", "image/bmp"},
      {".gif", "image/gif"},
      {".mp4", "video/mp4"},
      {".webm", "video/webm"},
  });
  for (const auto& [extension, type] : kTypes) {
    if (has_extension(name, std::array{extension})) return std::string(type);
  }
  return "application/octet-stream";
}

}  // namespace tarsier::web
