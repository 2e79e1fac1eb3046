// SPDX-License-Identifier: MIT
#include "forgotten_names.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"

#include "router.h"
#include <cctype>
#include <fstream>
#include <nlohmann/json.hpp>

namespace tarsier::web {
namespace {

using Json = nlohmann::json;

bool is_letter(char c) {
  const auto byte = static_cast<unsigned char>(c);
  return byte >= 0x80 || std::isalnum(byte) != 0;
}

// As JSON spells it, without the quotes.
std::string in_json(std::string_view name) {
  const std::string text = to_text(Json(name));
  return text.substr(1, text.size() - 2);
}

bool has_name(const std::string& line, std::string_view name) {
  return line.find(name) != std::string::npos || line.find(in_json(name)) != std::string::npos;
}

bool file_has_name(const std::string& path, std::string_view name) {
  std::ifstream in(path, std::ios::binary);
  bool found = false;
  for (std::string line; std::getline(in, line);) {
    if (line.find('\0') != std::string::npos) return false;
    found = found || has_name(line, name);
  }
  return found;
}

}  // namespace

std::string without_name(std::string text, std::string_view name) {
  if (name.empty()) return text;
  for (std::size_t at = text.find(name); at != std::string::npos; at = text.find(name, at)) {
    const std::size_t end = at + name.size();
    const bool continues_before = at > 0 && is_letter(text[at - 1]) && is_letter(name.front());
    const bool continues_behind =
        end < text.size() && is_letter(text[end]) && is_letter(name.back());
    if (continues_before || continues_behind) {
      ++at;
    } else {
      text.replace(at, name.size(), kForgotten);
      at += kForgotten.size();
    }
  }
  return text;
}

void remove_name(Json& value, std::string_view name) {
  if (value.is_string()) {
    value = without_name(value.get<std::string>(), name);
  } else if (value.is_structured()) {
    for (Json& item : value) remove_name(item, name);
  }
}

std::string line_without_name(const std::string& line, std::string_view name) {
  if (!has_name(line, name)) return line;
  Json json = Json::parse(line, nullptr, false);
  if (!json.is_structured()) return without_name(without_name(line, name), in_json(name));
  remove_name(json, name);
  return to_text(json);
}

void remove_name_from_file(const std::string& path, std::string_view name) {
  if (!file_has_name(path, name)) return;
  AtomicFile file(path);
  std::ifstream in(path, std::ios::binary);
  std::ofstream out(file.path(), std::ios::binary);
  for (std::string line; std::getline(in, line);) {
    out << line_without_name(line, name);
    if (!in.eof()) out << '\n';
  }
  out.close();
  if (in.bad() || !out) throw OutputError(path, "a forgotten name cannot be removed from it");
  file.commit();
}

}  // namespace tarsier::web
