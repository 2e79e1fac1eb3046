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
#include <filesystem>
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

// Whether the character ends a word of a list or a table.
bool is_break(char c) {
  return std::isspace(static_cast<unsigned char>(c)) != 0 || c == '"' || c == '\'' || c == ',' ||
         c == ';' || c == '>' || c == '=' || c == '[' || c == '(' || c == '\0';
}

std::vector<std::string> names_in_root() {
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator("/", error))
    names.push_back(entry.path().filename().string());
  return names;
}

// Whether `rest`, which begins with '/', begins with a path of this machine. Encoded bytes and
// fractions begin with '/' too, so the path must begin with a name that exists, end like the name
// of a file, or have characters that may stand for others.
bool begins_with_path(std::string_view rest, const std::vector<std::string>& root) {
  const std::string_view word(rest.begin(), std::find_if(rest.begin(), rest.end(), is_break));
  if (word.find_first_of("\\&") != std::string_view::npos) return true;
  while (rest.starts_with('/') || rest.starts_with("./")) rest.remove_prefix(1);
  const bool exists = std::any_of(root.begin(), root.end(), [&](const std::string& name) {
    if (!rest.starts_with(name)) return false;
    const char next = rest.size() == name.size() ? '/' : rest[name.size()];
    return std::isalnum(static_cast<unsigned char>(next)) == 0 &&
           std::string_view("+-_.").find(next) == std::string_view::npos;
  });
  if (exists) return true;
  const std::string_view file = word.substr(word.rfind('/') + 1);
  const std::string_view extension = file.substr(std::min(file.rfind('.'), file.size()));
  return extension.size() > 1 && std::isalpha(static_cast<unsigned char>(extension[1])) != 0;
}

// Verbs open the files named in lists and sets; none may be outside their folder.
bool names_foreign_files(std::string_view text) {
  const std::vector<std::string> root = names_in_root();
  for (std::size_t n = 0; n < text.size(); ++n) {
    const std::string_view rest = text.substr(n);
    // "/" and "." as JSON and XML may write them, and the folder above.
    for (const std::string_view sign :
         {"\\/", "\\u002f", "\\u002F", "\\u002e", "\\u002E", "&#", "../"}) {
      if (rest.starts_with(sign)) return true;
    }
    if (n > 0 && !is_break(text[n - 1])) continue;
    if (rest.starts_with("~/")) return true;
    if (rest.front() == '/' && begins_with_path(rest, root)) return true;
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
