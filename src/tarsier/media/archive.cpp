// SPDX-License-Identifier: MIT
#include "tarsier/media/archive.h"

#include "tarsier/core/base64.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <opencv2/core/cvdef.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <new>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <type_traits>
#include <utility>

namespace tarsier {
namespace {

using nlohmann::json;

// Length of the UTF-8 character at `at`, 0 if it is invalid (RFC 3629: no overlong forms, no
// surrogates).
std::size_t utf8_length(std::string_view text, std::size_t at) {
  const auto byte = [&](std::size_t i) {
    return at + i < text.size() ? static_cast<unsigned char>(text[at + i]) : 0U;
  };
  const auto follows = [&](std::size_t i) { return (byte(i) & 0xC0U) == 0x80U; };
  const unsigned first = byte(0);
  if (first < 0x80U) return 1;
  if (first >= 0xC2U && first <= 0xDFU) return follows(1) ? 2 : 0;
  if (first >= 0xE0U && first <= 0xEFU) {
    if (!follows(1) || !follows(2)) return 0;
    if (first == 0xE0U && byte(1) < 0xA0U) return 0;
    if (first == 0xEDU && byte(1) > 0x9FU) return 0;
    return 3;
  }
  if (first >= 0xF0U && first <= 0xF4U) {
    if (!follows(1) || !follows(2) || !follows(3)) return 0;
    if (first == 0xF0U && byte(1) < 0x90U) return 0;
    if (first == 0xF4U && byte(1) > 0x8FU) return 0;
    return 4;
  }
  return 0;
}

std::string position_text(std::string_view text, std::size_t at) {
  const std::string_view before = text.substr(0, std::min(at, text.size()));
  const auto line = std::count(before.begin(), before.end(), '\n') + 1;
  const std::size_t start = before.rfind('\n');
  const std::size_t column =
      start == std::string_view::npos ? before.size() + 1 : before.size() - start;
  return fmt::format("line {}, column {}", line, column);
}

// Whether a byte represents itself in a JSON text: printable ASCII except quote and backslash. It
// has no branches and uses one byte, so that compilers can vectorise it.
constexpr bool is_plain(char c) {
  const auto byte = static_cast<signed char>(c);  // beyond ASCII: negative
  return !((byte < 0x20) | (byte == '"') | (byte == '\\'));
}

// The first position from `at` that is not plain.
std::size_t end_of_plain(std::string_view text, std::size_t at) {
  constexpr std::size_t kBlock = 64;
  for (; at + kBlock <= text.size(); at += kBlock) {
    unsigned char others = 0;
    for (std::size_t k = 0; k < kBlock; ++k)
      others =
          static_cast<unsigned char>(others | static_cast<unsigned char>(!is_plain(text[at + k])));
    if (others != 0) break;
  }
  while (at < text.size() && is_plain(text[at])) ++at;
  return at;
}

// A long text of only plain bytes, such as packed numbers. It needs no decoding, so the parser,
// which is slow for texts, need not see it.
struct LongText {
  std::size_t number;  // index among all texts of the file, names included
  std::size_t begin;   // between the quotes
  std::size_t end;
};
constexpr std::size_t kLongText = 256;  // bytes

// Whether the text that ends with the quote at `end` is the name of a member.
bool is_name(std::string_view text, std::size_t end) {
  const std::size_t next = text.find_first_not_of(" \t\r\n", end + 1);
  return next != std::string_view::npos && text[next] == ':';
}

// What makes a text dangerous for a parser; empty if nothing. One pass, no recursion. Lists the
// long texts.
std::string limit_violation(std::string_view text, const ArchiveLimits& limits,
                            std::vector<LongText>& long_texts) {
  if (static_cast<std::uint64_t>(text.size()) > static_cast<std::uint64_t>(limits.max_bytes)) {
    return fmt::format("{} bytes are more than the limit of {}", text.size(), limits.max_bytes);
  }
  int depth = 0;
  std::int64_t values = 1;
  std::size_t texts = 0;
  bool in_text = false;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t length = utf8_length(text, at);
    if (length == 0) return fmt::format("{}: not UTF-8", position_text(text, at));
    const char c = text[at];
    if (in_text) {
      if (c == '\\' && at + 1 < text.size()) {
        // In a valid text an escaped character is one ASCII byte; the parser refuses all others.
        at += 1 + std::max<std::size_t>(1, utf8_length(text, at + 1));
        continue;
      }
      in_text = c != '"';
    } else if (c == '"') {
      const std::size_t end = end_of_plain(text, at + 1);
      const bool is_whole = end < text.size() && text[end] == '"';
      if (is_whole && end - at > kLongText && !is_name(text, end))
        long_texts.push_back({texts, at + 1, end});
      ++texts;
      in_text = !is_whole;
      at = is_whole ? end + 1 : end;
      continue;
    } else if (c == '[' || c == '{') {
      ++values;
      if (++depth > limits.max_depth) {
        return fmt::format("{}: nested deeper than {}", position_text(text, at), limits.max_depth);
      }
    } else if (c == ']' || c == '}') {
      --depth;
    } else if (c == ',') {
      ++values;
    }
    if (values > limits.max_values) return fmt::format("more than {} values", limits.max_values);
    at += length;
  }
  return {};
}

// The text with the contents of the long texts removed.
std::string without_long_texts(std::string_view text, const std::vector<LongText>& long_texts) {
  std::string rest;
  std::size_t from = 0;
  for (const LongText& part : long_texts) {
    rest += text.substr(from, part.begin - from);
    from = part.end;
  }
  return rest += text.substr(from);
}

// Converts a position in that text to a position in the whole text.
std::size_t position_in_original(std::size_t at, const std::vector<LongText>& long_texts) {
  for (const LongText& part : long_texts) {
    if (at < part.begin) break;
    at += part.end - part.begin;
  }
  return at;
}

// Parses `rest` and puts the long texts of the whole `text` back.
json with_long_texts(std::string_view rest, std::string_view text,
                     const std::vector<LongText>& long_texts) {
  if (long_texts.empty()) return json::parse(rest);
  std::size_t texts = 0;
  auto next = long_texts.begin();
  const auto put_back = [&](int, json::parse_event_t event, json& parsed) {
    const bool is_text = event == json::parse_event_t::key ||
                         (event == json::parse_event_t::value && parsed.is_string());
    if (!is_text) return true;
    if (next != long_texts.end() && next->number == texts) {
      parsed = std::string(text.substr(next->begin, next->end - next->begin));
      ++next;
    }
    ++texts;
    return true;
  };
  return json::parse(rest, put_back);
}

// The parsed text, or the error.
std::pair<json, std::string> parse(std::string_view text, const ArchiveLimits& limits) {
  TARSIER_REQUIRE(limits.max_bytes >= 1 && limits.max_depth >= 1 && limits.max_values >= 1,
                  "limits of {} bytes, depth {}, {} values", limits.max_bytes, limits.max_depth,
                  limits.max_values);
  std::vector<LongText> long_texts;
  std::string violation = limit_violation(text, limits, long_texts);
  if (!violation.empty()) return {json(), std::move(violation)};
  if (text.find_first_not_of(" \t\r\n") == std::string_view::npos) return {json(), "empty"};
  try {
    const std::string shortened = long_texts.empty() ? "" : without_long_texts(text, long_texts);
    return {with_long_texts(long_texts.empty() ? text : shortened, text, long_texts), ""};
  } catch (const json::parse_error& error) {
    const std::size_t at = position_in_original(error.byte > 0 ? error.byte - 1 : 0, long_texts);
    if (at >= text.size()) return {json(), "ends too early: not complete JSON"};
    const std::string_view rest = text.substr(at, 16);
    return {json(), fmt::format("{}: not JSON at \"{}\"", position_text(text, at),
                                printable(rest.substr(0, rest.find('\n'))))};
  } catch (const json::exception&) {
    return {json(), "a number is out of range"};
  } catch (const std::bad_alloc&) {
    return {json(), "not enough memory"};
  }
}

// Where in `value` a number is not finite or a text is not UTF-8; nullopt if all can be written.
std::optional<std::string> find_unwritable(const json& value, const std::string& where) {
  if (value.is_number_float() && !std::isfinite(value.get<double>()))
    return where + " is not a finite number";
  const auto is_utf8 = [](std::string_view text) {
    for (std::size_t at = 0; at < text.size();) {
      const std::size_t length = utf8_length(text, at);
      if (length == 0) return false;
      at += length;
    }
    return true;
  };
  if (value.is_string() && !is_utf8(value.get_ref<const std::string&>()))
    return where + " is not UTF-8";
  if (value.is_binary() || value.is_discarded()) return where + " has no form in JSON";
  if (value.is_array()) {
    for (std::size_t i = 0; i < value.size(); ++i) {
      if (auto found = find_unwritable(value[i], fmt::format("{}[{}]", where, i))) return found;
    }
  }
  if (value.is_object()) {
    for (const auto& [name, item] : value.items()) {
      if (!is_utf8(name)) return "a name in " + where + " is not UTF-8";
      if (auto found = find_unwritable(item, where + "." + name)) return found;
    }
  }
  return std::nullopt;
}

template <typename T>
constexpr std::string_view dtype_of() {
  if constexpr (std::is_same_v<T, double>) return "f8";
  if constexpr (std::is_same_v<T, float>) return "f4";
  if constexpr (std::is_same_v<T, cv::float16_t>) return "f2";
  if constexpr (std::is_same_v<T, std::int32_t>) return "i4";
  if constexpr (std::is_same_v<T, std::uint8_t>) return "u1";
}

// Files are little-endian on every machine.
void swap_bytes_if_big_endian(std::span<std::uint8_t> bytes, std::size_t size) {
  if constexpr (std::endian::native == std::endian::big) {
    for (std::size_t i = 0; i + size <= bytes.size(); i += size) {
      std::reverse(bytes.begin() + static_cast<std::ptrdiff_t>(i),
                   bytes.begin() + static_cast<std::ptrdiff_t>(i + size));
    }
  }
}

template <typename T>
bool all_finite(const std::vector<T>& values) {
  if constexpr (!std::is_integral_v<T>) {
    return std::all_of(values.begin(), values.end(),
                       [](T v) { return std::isfinite(static_cast<double>(v)); });
  }
  return true;
}

// The number of values; nullopt if a size is negative or the array is larger than any readable
// file. Each size must fit an int, also in an array that has a size of 0.
std::optional<std::uint64_t> product_of(std::span<const std::int64_t> shape) {
  constexpr std::uint64_t kMaxCount = std::numeric_limits<std::int32_t>::max();
  std::uint64_t product = 1;
  bool is_empty = false;
  for (const std::int64_t size : shape) {
    if (size < 0 || static_cast<std::uint64_t>(size) > kMaxCount) return std::nullopt;
    if (size == 0) {
      is_empty = true;
      continue;
    }
    product *= static_cast<std::uint64_t>(size);  // of two numbers below 2^31
    if (product > kMaxCount) return std::nullopt;
  }
  return is_empty ? 0 : product;
}

}  // namespace

void write_archive(const std::string& path, const Archive& archive) {
  TARSIER_REQUIRE(!archive.type.empty() && archive.version >= 1, "type '{}', version {}",
                  archive.type, archive.version);
  TARSIER_REQUIRE(archive.payload.is_object(), "the payload of {} is not a JSON object", path);
  TARSIER_REQUIRE(archive.provenance.is_object() || archive.provenance.is_null(),
                  "the provenance of {} is not a JSON object", path);
  const json provenance = archive.provenance.is_null() ? json::object() : archive.provenance;
  for (const auto& [name, value] :
       {std::pair<std::string, const json*>{"payload", &archive.payload},
        {"provenance", &provenance}}) {
    if (const auto found = find_unwritable(*value, name)) throw OutputError(path, *found);
  }
  std::string text;
  try {
    // Formatted here, so that the members that people look for come first.
    text = fmt::format(
        "{{\n\"type\": {},\n\"version\": {},\n\"provenance\": {},\n\"payload\": {}\n}}\n",
        json(archive.type).dump(), archive.version, provenance.dump(1), archive.payload.dump(1));
  } catch (const json::exception&) {
    throw OutputError(path, "the type is not UTF-8");
  }
  write_file_atomically(path, text);
}

Archive read_any_archive(const std::string& path, const ArchiveLimits& limits) {
  std::string text;
  try {
    text = read_file(path, limits.max_bytes);
  } catch (const InputError& error) {
    const std::string what = error.what();
    throw ModelError(path, what.substr(std::min(what.size(), path.size() + 2)));
  }
  auto [root, error] = parse(text, limits);
  if (!error.empty()) throw ModelError(path, error);
  if (!root.is_object() || !root.contains("type") || !root.contains("version") ||
      !root.contains("payload")) {
    throw ModelError(path, "not a Tarsier model file: type, version and payload are expected");
  }
  Archive archive;
  archive.type = text_member(root, "type", path, 200);
  archive.version = static_cast<int>(integer_member(root, "version", path, 1, 1'000'000));
  archive.provenance = root.contains("provenance") ? std::move(root["provenance"]) : json::object();
  archive.payload = std::move(root["payload"]);
  if (archive.type.empty()) throw ModelError(path, "type is empty");
  if (!archive.provenance.is_object()) throw ModelError(path, "'provenance': expected an object");
  if (!archive.payload.is_object()) throw ModelError(path, "'payload': expected an object");
  return archive;
}

Archive read_archive(const std::string& path, std::string_view type, int newest_version,
                     const ArchiveLimits& limits) {
  Archive archive = read_any_archive(path, limits);
  if (archive.type != type) {
    throw ModelError(
        path, fmt::format("is a model of type '{}', expected '{}'", printable(archive.type), type));
  }
  if (archive.version > newest_version) {
    throw ModelError(path,
                     fmt::format("version {} is newer than this program reads ({}): update tarsier",
                                 archive.version, newest_version));
  }
  return archive;
}

json parse_json(std::string_view text, const std::string& name, const ArchiveLimits& limits) {
  auto [root, error] = parse(text, limits);
  if (!error.empty()) throw InputError(name, error);
  return std::move(root);
}

template <typename T>
json pack(const PackedArray<T>& array) {
  const auto count = product_of(array.shape);
  TARSIER_REQUIRE(count && *count == array.values.size(), "shape ({}) with {} values",
                  fmt::join(array.shape, ", "), array.values.size());
  TARSIER_REQUIRE(all_finite(array.values), "a value of {} is not finite", array.values.size());
  std::vector<std::uint8_t> bytes(array.values.size() * sizeof(T));
  if (!bytes.empty()) std::memcpy(bytes.data(), array.values.data(), bytes.size());
  swap_bytes_if_big_endian(bytes, sizeof(T));
  return {{"dtype", dtype_of<T>()}, {"shape", array.shape}, {"data", to_base64(bytes)}};
}

float rounded_to_half(float value) { return static_cast<float>(cv::float16_t(value)); }

json pack_half(const PackedArray<float>& array) {
  PackedArray<cv::float16_t> halves{array.shape, {}};
  for (const float value : array.values) {
    halves.values.emplace_back(value);
    TARSIER_REQUIRE(std::isfinite(static_cast<float>(halves.values.back())),
                    "{} is beyond half precision", value);
  }
  return pack(halves);
}

namespace {

template <typename T>
PackedArray<T> unpack_as(const json& value, const std::string& path, std::string_view what,
                         std::initializer_list<std::int64_t> shape) {
  const auto fail = [&](const std::string& reason) {
    throw ModelError(path, fmt::format("{}: {}", what, reason));
  };
  if (!value.is_object() || !value.contains("dtype") || !value.contains("shape") ||
      !value.contains("data") || !value["dtype"].is_string() || !value["shape"].is_array() ||
      !value["data"].is_string()) {
    fail("no packed array (dtype, shape and data are expected)");
  }
  if (value["dtype"].get_ref<const std::string&>() != dtype_of<T>()) {
    fail(fmt::format("dtype '{}', expected '{}'",
                     printable(value["dtype"].get_ref<const std::string&>()), dtype_of<T>()));
  }
  PackedArray<T> array;
  for (const json& size : value["shape"]) {
    if (!size.is_number_integer() || array.shape.size() >= 8) fail("the shape makes no sense");
    // Unsigned numbers beyond int64 become negative and are therefore refused.
    array.shape.push_back(size.get<std::int64_t>());
  }
  const auto count = product_of(array.shape);
  if (!count) fail("the shape makes no sense");
  const bool fits = array.shape.size() == shape.size() &&
                    std::equal(shape.begin(), shape.end(), array.shape.begin(),
                               [](std::int64_t expected, std::int64_t given) {
                                 return expected < 0 || expected == given;
                               });
  if (!fits) {
    fail(fmt::format("shape ({}), expected ({})", fmt::join(array.shape, ", "),
                     fmt::join(shape, ", ")));
  }
  const std::string_view data = value["data"].get_ref<const std::string&>();
  const auto size = base64_size(data);
  if (!size) fail("the data is not base64");
  if (*size != *count * sizeof(T)) {
    fail(from_base64(data) ? fmt::format("{} bytes of data for {} values", *size, *count)
                           : "the data is not base64");
  }
  array.values.resize(static_cast<std::size_t>(*count));
  const std::span<std::uint8_t> bytes(reinterpret_cast<std::uint8_t*>(array.values.data()), *size);
  if (!from_base64(data, bytes)) fail("the data is not base64");
  swap_bytes_if_big_endian(bytes, sizeof(T));
  if (!all_finite(array.values)) fail("a value is not finite");
  return array;
}

}  // namespace

template <typename T>
PackedArray<T> unpack(const json& value, const std::string& path, std::string_view what,
                      std::initializer_list<std::int64_t> shape) {
  if constexpr (std::is_same_v<T, float>) {
    if (value.is_object() && value.value("dtype", json()) == dtype_of<cv::float16_t>()) {
      PackedArray<cv::float16_t> halves = unpack_as<cv::float16_t>(value, path, what, shape);
      return {std::move(halves.shape), {halves.values.begin(), halves.values.end()}};
    }
  }
  return unpack_as<T>(value, path, what, shape);
}

template json pack(const PackedArray<double>&);
template json pack(const PackedArray<float>&);
template json pack(const PackedArray<std::int32_t>&);
template json pack(const PackedArray<std::uint8_t>&);
template PackedArray<double> unpack(const json&, const std::string&, std::string_view,
                                    std::initializer_list<std::int64_t>);
template PackedArray<float> unpack(const json&, const std::string&, std::string_view,
                                   std::initializer_list<std::int64_t>);
template PackedArray<std::int32_t> unpack(const json&, const std::string&, std::string_view,
                                          std::initializer_list<std::int64_t>);
template PackedArray<std::uint8_t> unpack(const json&, const std::string&, std::string_view,
                                          std::initializer_list<std::int64_t>);

const json& member(const json& object, const std::string& name, const std::string& path) {
  if (!object.is_object())
    throw ModelError(path,
                     fmt::format("'{}' is missing: expected an object that contains it", name));
  const auto found = object.find(name);
  if (found == object.end()) throw ModelError(path, fmt::format("'{}' is missing", name));
  return *found;
}

double number_member(const json& object, const std::string& name, const std::string& path,
                     double low, double high) {
  const json& value = member(object, name, path);
  if (!value.is_number()) throw ModelError(path, fmt::format("'{}': expected a number", name));
  const double number = value.get<double>();
  if (!(number >= low && number <= high)) {
    throw ModelError(path, fmt::format("'{}' is {}, outside {}..{}", name, number, low, high));
  }
  return number;
}

std::int64_t integer_member(const json& object, const std::string& name, const std::string& path,
                            std::int64_t low, std::int64_t high) {
  const json& value = member(object, name, path);
  if (!value.is_number_integer())
    throw ModelError(path, fmt::format("'{}': expected a whole number", name));
  const bool beyond = value.is_number_unsigned() &&
                      value.get<std::uint64_t>() >
                          static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
  const std::int64_t number = beyond ? 0 : value.get<std::int64_t>();
  if (beyond || number < low || number > high) {
    throw ModelError(path,
                     fmt::format("'{}' is {}, outside {}..{}", name, value.dump(), low, high));
  }
  return number;
}

std::string text_member(const json& object, const std::string& name, const std::string& path,
                        std::size_t max_bytes) {
  const json& value = member(object, name, path);
  if (!value.is_string()) throw ModelError(path, fmt::format("'{}': expected a text", name));
  const auto& text = value.get_ref<const std::string&>();
  if (text.size() > max_bytes) {
    throw ModelError(path,
                     fmt::format("'{}' has {} bytes, more than {}", name, text.size(), max_bytes));
  }
  return text;
}

}  // namespace tarsier
