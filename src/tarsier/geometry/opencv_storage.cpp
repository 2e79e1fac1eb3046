// SPDX-License-Identifier: MIT
#include "tarsier/geometry/opencv_storage.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace tarsier::geometry {
namespace {

class YamlParser {
 public:
  explicit YamlParser(const std::string& path) : path_(path) {}

  StoredEntries parse(std::string_view text) {
    while (!text.empty()) {
      ++line_;
      const std::string_view line = next_line(text);
      if (line_ > 1) parse_line(line);
    }
    if (open_ > 0) fail("a '[' is not closed");
    return std::move(entries_);
  }

 private:
  [[noreturn]] void fail(const std::string& reason) const {
    throw InputError(path_, fmt::format("line {}: {}", line_, reason));
  }

  void parse_line(std::string_view line) {
    const std::string_view content = trimmed(line);
    if (open_ > 0) return add(content);
    if (content.empty() || content.front() == '#' || content == "---" || content == "...") return;
    const auto indent = static_cast<std::size_t>(content.data() - line.data());
    const std::size_t colon = content.find(':');
    const bool has_key = colon != std::string_view::npos && content.front() != '-';
    const std::string key(trimmed(content.substr(0, has_key ? colon : 0)));
    const std::string_view value = has_key ? trimmed(content.substr(colon + 1)) : content;
    if (indent == 0) {
      if (!has_key) fail("'name: value' of OpenCV is expected");
      const auto [iterator, is_new] = entries_.try_emplace(key);
      if (!is_new) fail(fmt::format("a second '{}'", printable(key)));
      entry_ = &iterator->second;
      part_indent_ = 0;
      return start(entry_->text, value);
    }
    if (entry_ == nullptr) fail("'name: value' of OpenCV is expected");
    if (part_indent_ == 0) part_indent_ = indent;
    if (!has_key || indent != part_indent_) return;  // of a list, a long text, or a deeper level
    const auto [iterator, is_new] = entry_->parts.try_emplace(key);
    if (!is_new) fail(fmt::format("a second '{}'", printable(key)));
    start(iterator->second, value);
  }

  // A list may continue over many lines.
  void start(std::string& target, std::string_view value) {
    target_ = &target;
    if (value.starts_with('[')) return add(value);
    target = value;
  }

  void add(std::string_view text) {
    open_ += std::count(text.begin(), text.end(), '[') - std::count(text.begin(), text.end(), ']');
    target_->append(text).push_back(' ');
  }

  const std::string& path_;
  StoredEntries entries_;
  StoredEntry* entry_ = nullptr;
  std::string* target_ = nullptr;
  std::size_t part_indent_ = 0;
  std::ptrdiff_t open_ = 0;  // '[' minus ']'
  std::int64_t line_ = 0;
};

class XmlParser {
 public:
  explicit XmlParser(const std::string& path) : path_(path) {}

  StoredEntries parse(std::string_view text) {
    while (!text.empty()) {
      const std::size_t start = std::min(text.find('<'), text.size());
      if (target_ != nullptr) target_->append(text.substr(0, start));
      text.remove_prefix(start);
      if (text.empty()) break;
      if (text.starts_with("<!--")) {
        skip_behind("-->", text);
      } else if (text.starts_with("<?")) {
        skip_behind("?>", text);
      } else {
        parse_tag(text);
      }
    }
    if (!names_.empty()) fail(fmt::format("<{}> is not closed", printable(names_.back())));
    return std::move(entries_);
  }

 private:
  [[noreturn]] void fail(const std::string& reason) const { throw InputError(path_, reason); }

  void skip_behind(std::string_view end, std::string_view& text) const {
    const std::size_t position = text.find(end);
    if (position == std::string_view::npos) fail(fmt::format("is cut short: '{}' is missing", end));
    text.remove_prefix(position + end.size());
  }

  void parse_tag(std::string_view& text) {
    char quote = 0;  // a quoted character does not end the tag
    std::size_t end = 1;
    for (; end < text.size() && (quote != 0 || text[end] != '>'); ++end) {
      if (quote != 0 ? text[end] == quote : text[end] == '"' || text[end] == '\'')
        quote = quote != 0 ? '\0' : text[end];
    }
    if (end >= text.size()) fail("is cut short: '>' is missing");
    std::string_view tag = text.substr(1, end - 1);
    text.remove_prefix(end + 1);

    const bool closes = tag.starts_with('/');
    const bool is_whole = tag.ends_with('/');
    if (closes) tag.remove_prefix(1);
    const std::string name(tag.substr(0, tag.find_first_of(" \t\r\n/")));
    if (name.empty() || name.front() == '!')
      fail(fmt::format("'<{}>' is not a tag of OpenCV", printable(tag.substr(0, 60))));
    if (closes) {
      if (names_.empty() || names_.back() != name)
        fail(fmt::format("</{}> closes nothing", printable(name.substr(0, 60))));
      names_.pop_back();
      target_ = nullptr;
      return;
    }
    open(name);
    if (is_whole) {
      names_.pop_back();
      target_ = nullptr;
    }
  }

  void open(const std::string& name) {
    const std::size_t depth = names_.size();
    target_ = nullptr;
    if (depth == 0 && name != "opencv_storage") fail("is XML, but not of OpenCV");
    bool is_new = true;
    if (depth == 1) {
      const auto [iterator, inserted] = entries_.try_emplace(name);
      is_new = inserted;
      entry_ = &iterator->second;
      target_ = &entry_->text;
    } else if (depth == 2 && name != "_") {  // "_" is an element of a list
      const auto [iterator, inserted] = entry_->parts.try_emplace(name);
      is_new = inserted;
      target_ = &iterator->second;
    }
    if (!is_new) fail(fmt::format("a second <{}>", printable(name.substr(0, 60))));
    names_.push_back(name);
  }

  const std::string& path_;
  StoredEntries entries_;
  StoredEntry* entry_ = nullptr;
  std::string* target_ = nullptr;   // receives text
  std::vector<std::string> names_;  // of the open tags
};

}  // namespace

StoredEntries parse_opencv_storage(std::string_view text, const std::string& path) {
  return text.starts_with("<?xml") ? XmlParser(path).parse(text) : YamlParser(path).parse(text);
}

}  // namespace tarsier::geometry
