// SPDX-License-Identifier: MIT
#include "json_mutator.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::fuzz {
namespace {

using nlohmann::json;

constexpr std::string_view kAlphabet =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

std::string to_base64(const std::vector<std::uint8_t>& bytes) {
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - i);
    for (std::size_t k = 0; k < 3; ++k) group = group << 8U | (k < count ? bytes[i + k] : 0U);
    for (unsigned k = 0; k < 4; ++k)
      text += k <= count ? kAlphabet[group >> (18 - 6 * k) & 0x3FU] : '=';
  }
  return text;
}

std::vector<std::uint8_t> from_base64(std::string_view text) {
  std::vector<std::uint8_t> bytes;
  std::uint32_t bits = 0;
  int held = 0;
  for (const char c : text) {
    const std::size_t value = kAlphabet.find(c);
    if (value == std::string_view::npos) break;
    bits = bits << 6U | static_cast<std::uint32_t>(value);
    held += 6;
    if (held >= 8) bytes.push_back(static_cast<std::uint8_t>(bits >> (held -= 8)));
  }
  return bytes;
}

class Mutation {
 public:
  Mutation(unsigned seed, std::size_t max_size, MutateBytes mutate_bytes)
      : random_(seed), max_size_(max_size), mutate_bytes_(mutate_bytes) {}

  std::size_t below(std::size_t count) { return random_() % count; }

  void change(json& root) {
    for (std::size_t k = 1 + below(3); k > 0; --k) {
      nodes_.clear();
      collect(root);
      change_node(*nodes_[below(nodes_.size())]);
    }
  }

  std::string change_text(std::string text) {
    const std::size_t size = text.size();
    text.resize(std::min<std::size_t>(max_size_, 2 * size + 16));
    const std::size_t given = std::min(size, text.size());
    text.resize(mutate_bytes_(reinterpret_cast<std::uint8_t*>(text.data()), given, text.size()));
    return text;
  }

 private:
  void collect(json& node) {
    nodes_.push_back(&node);
    if (is_packed(node)) return;
    if (node.is_structured()) {
      for (json& item : node) collect(item);
    }
  }

  static bool is_packed(const json& node) {
    return node.is_object() && node.contains("data") && node["data"].is_string() &&
           node.contains("shape") && node["shape"].is_array() && node.contains("dtype") &&
           node["dtype"].is_string();
  }

  void change_node(json& node) {
    if (below(12) == 0) {
      node = odd_value();
    } else if (below(12) == 0) {
      node = json(*nodes_[below(nodes_.size())]);  // a copy of another node
    } else if (is_packed(node)) {
      change_packed(node);
    } else if (node.is_object()) {
      change_object(node);
    } else if (node.is_array()) {
      change_array(node);
    } else if (node.is_number()) {
      change_number(node);
    } else if (node.is_string()) {
      node = printable(change_text(node.get<std::string>()));
    } else {
      node = odd_value();
    }
  }

  void change_object(json& node) {
    if (node.empty() || below(8) == 0) {
      node["x"] = odd_value();
      return;
    }
    auto item = node.begin();
    std::advance(item, below(node.size()));
    if (below(2) == 0) {
      node.erase(item);
    } else {
      item.value() = odd_value();
    }
  }

  void change_array(json& node) {
    const std::size_t at = node.empty() ? 0 : below(node.size());
    switch (node.empty() ? 3 : below(5)) {
      case 0:
        node.erase(node.begin() + static_cast<std::ptrdiff_t>(at));
        break;
      case 1:
        node.insert(node.begin() + static_cast<std::ptrdiff_t>(at), json(node[at]));
        break;
      case 2:
        std::swap(node[at], node[below(node.size())]);
        break;
      case 3:
        node.push_back(odd_value());
        break;
      default:
        if (node.size() < 5000) {  // doubled
          const json copy = node;
          node.insert(node.end(), copy.begin(), copy.end());
        }
    }
  }

  void change_number(json& node) {
    switch (below(4)) {
      case 0:
        node = node.is_number_float() ? json(node.get<double>() * (below(2) == 0 ? 2 : 0.5))
                                      : json(odd_integer());
        break;
      case 1:
        node = node.is_number_integer()
                   ? json(static_cast<std::int64_t>(node.get<std::uint64_t>() +
                                                    (below(2) == 0 ? 1U : ~0ULL)))
                   : json(-node.get<double>());
        break;
      default:
        node = odd_number();
    }
  }

  void change_packed(json& node) {
    const std::string dtype = node["dtype"].get<std::string>();
    const std::size_t width = dtype == "f8" ? 8 : dtype == "u1" ? 1 : 4;
    std::vector<std::uint8_t> bytes = from_base64(node["data"].get_ref<const std::string&>());
    json& shape = node["shape"];
    const std::size_t dimension = shape.empty() ? 0 : below(shape.size());
    switch (below(7)) {
      case 0:
      case 1:
      case 2:  // single values
        for (std::size_t k = 1 + below(3); k > 0 && bytes.size() >= width; --k)
          odd_bytes(dtype, bytes.data() + width * below(bytes.size() / width));
        break;
      case 3:
        if (!shape.empty()) shape[dimension] = odd_integer();
        break;
      case 4:
        if (shape.size() > 1) std::swap(shape[dimension], shape[below(shape.size())]);
        break;
      case 5: {  // another size with as many values
        if (shape.empty() || !shape[dimension].is_number_unsigned()) break;
        static constexpr std::array<std::uint64_t, 6> kSizes{0, 1, 2, 3, 5, 64};
        const auto old = std::max<std::uint64_t>(1, shape[dimension].get<std::uint64_t>());
        const std::uint64_t now =
            below(2) == 0 ? kSizes[below(kSizes.size())] : old + (below(2) == 0 ? 1 : ~0ULL);
        shape[dimension] = now;
        const std::size_t count = bytes.size() / width / old * now * width;
        if (count <= max_size_) bytes.resize(count, bytes.empty() ? 0 : bytes.back());
        break;
      }
      default: {
        static constexpr std::array<const char*, 5> kTypes{"f8", "f4", "i4", "u1", "x"};
        node["dtype"] = kTypes[below(kTypes.size())];
      }
    }
    node["data"] = to_base64(bytes);
  }

  template <typename T>
  void put(std::uint8_t* at, T value) {
    std::memcpy(at, &value, sizeof value);
  }

  void odd_bytes(const std::string& dtype, std::uint8_t* at) {
    const double value = below(6) == 0   ? std::numeric_limits<double>::quiet_NaN()
                         : below(6) == 0 ? std::numeric_limits<double>::infinity()
                                         : odd_double();
    if (dtype == "f8") {
      put(at, value);
    } else if (dtype == "f4") {
      put(at, std::abs(value) > 3e38 ? (below(2) == 0 ? 3.4e38F : -3.4e38F)
                                     : static_cast<float>(value));
    } else if (dtype == "u1") {
      *at = static_cast<std::uint8_t>(random_());
    } else {
      put(at, static_cast<std::int32_t>(odd_integer()));
    }
  }

  std::int64_t odd_integer() {
    static constexpr std::array<std::int64_t, 24> kOdd{
        0,          1,           -1,         2,         3,         4,
        5,          7,           16,         64,        255,       256,
        1000,       10'000,      65'536,     1'000'000, 1 << 30,   2'147'483'647,
        2147483648, -2147483648, 4294967296, 1LL << 40, INT64_MAX, INT64_MIN};
    return kOdd[below(kOdd.size())];
  }

  double odd_double() {
    static constexpr std::array<double, 20> kOdd{0,     -0.0, 0.5,   1,     -1,       2,     1e-3,
                                                 1e3,   1e6,  1e9,   -1e9,  1e15,     1e-15, 1e30,
                                                 -1e30, 1e38, 1e300, 1e308, -1.7e308, 5e-324};
    return kOdd[below(kOdd.size())];
  }

  json odd_number() { return below(2) == 0 ? json(odd_integer()) : json(odd_double()); }

  json odd_value() {
    switch (below(8)) {
      case 0:
        return json::object();
      case 1:
        return json::array();
      case 2:
        return nullptr;
      case 3:
        return below(2) == 0;
      case 4:
        return below(2) == 0 ? "" : "x\n\x1b[1m";
      case 5:
        return json(*nodes_[below(nodes_.size())]);
      default:
        return odd_number();
    }
  }

  // Any text that JSON can contain.
  static std::string printable(std::string text) {
    for (char& c : text)
      if (static_cast<unsigned char>(c) >= 0x80) c = static_cast<char>(c & 0x7f);
    return text;
  }

  std::minstd_rand random_;
  std::size_t max_size_;
  MutateBytes mutate_bytes_;
  std::vector<json*> nodes_;
};

}  // namespace

std::size_t mutate_json(std::uint8_t* data, std::size_t size, std::size_t max_size, unsigned seed,
                        MutateBytes mutate_bytes) {
  Mutation mutation(seed, max_size, mutate_bytes);
  if (mutation.below(8) == 0) return mutate_bytes(data, size, max_size);
  std::string text(reinterpret_cast<const char*>(data), size);
  std::size_t begin = 0;
  std::size_t length = text.size();
  json root = json::parse(text, nullptr, false);
  if (root.is_discarded()) {  // one of several lines
    std::vector<std::size_t> starts{0};
    for (std::size_t i = 0; i < text.size(); ++i)
      if (text[i] == '\n') starts.push_back(i + 1);
    begin = starts[mutation.below(starts.size())];
    length = std::min(text.find('\n', begin), text.size()) - begin;
    root = json::parse(text.substr(begin, length), nullptr, false);
    if (root.is_discarded()) return mutate_bytes(data, size, max_size);
  }
  mutation.change(root);
  text.replace(begin, length, root.dump(-1, ' ', false, json::error_handler_t::replace));
  if (text.size() > max_size) return mutate_bytes(data, size, max_size);
  std::memcpy(data, text.data(), text.size());
  return text.size();
}

}  // namespace tarsier::fuzz
