// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/sha256.h"

#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

// Files of the cache: a line with the format version, the SHA-256 of the content, and plain numbers
// in the machine's own byte order (the files are not exchanged).
namespace tarsier::sfm {

constexpr std::string_view kPackedMagic = "tarsier-sfm-1\n";
constexpr std::uint64_t kMaxPackedItems = 2'000'000'000;

inline std::string sha256_of(std::string_view bytes) {
  Sha256 sum;
  sum.add(bytes);
  return sum.hex();
}

class PackedWriter {
 public:
  template <typename T>
  void put(const T& value) {
    static_assert(std::is_standard_layout_v<T> &&
                  std::is_trivially_destructible_v<T>);  // numbers, and structs of numbers
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(T));
  }
  template <typename T>
  void put(const std::vector<T>& values) {
    put(std::span<const T>(values));
  }
  template <typename T>
  void put(std::span<const T> values) {
    static_assert(std::is_standard_layout_v<T> && std::is_trivially_destructible_v<T>);
    put(static_cast<std::uint64_t>(values.size()));
    if (!values.empty())
      bytes_.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  }
  void put(const std::string& text) { put(std::vector<char>(text.begin(), text.end())); }

  // Returns the SHA-256 of the content. Throws OutputError.
  // NOLINTNEXTLINE(modernize-use-nodiscard): the file is the result
  std::string write(const std::string& path) const {
    std::string sum = sha256_of(bytes_);
    write_file_atomically(path, std::string(kPackedMagic) + sum + bytes_);
    return sum;
  }

 private:
  std::string bytes_;
};

// Thrown by readers where the content is not what was written.
class Damaged {};

class PackedReader {
 public:
  // Throws InputError (no such file, too large), Damaged.
  PackedReader(const std::string& path, std::int64_t max_bytes)
      : file_(read_file(path, max_bytes)) {
    const std::size_t head = kPackedMagic.size() + 64;
    if (file_.size() < head ||
        std::string_view(file_).substr(0, kPackedMagic.size()) != kPackedMagic) {
      throw Damaged();
    }
    remaining_ = std::string_view(file_).substr(head);
    if (sha256_of(remaining_) != std::string_view(file_).substr(kPackedMagic.size(), 64))
      throw Damaged();
  }

  // The SHA-256 of the content.
  [[nodiscard]] std::string_view sum() const {
    return std::string_view(file_).substr(kPackedMagic.size(), 64);
  }
  [[nodiscard]] bool is_at_end() const { return remaining_.empty(); }

  template <typename T>
  T get() {
    T value;
    read_bytes(&value, sizeof(T));
    return value;
  }
  template <typename T>
  std::vector<T> get_all() {
    const auto count = get<std::uint64_t>();
    if (count > kMaxPackedItems || count * sizeof(T) > remaining_.size()) throw Damaged();
    std::vector<T> values(static_cast<std::size_t>(count));
    if (count > 0) read_bytes(values.data(), values.size() * sizeof(T));
    return values;
  }
  std::string get_text() {
    const std::vector<char> text = get_all<char>();
    return {text.begin(), text.end()};
  }

 private:
  void read_bytes(void* to, std::size_t bytes) {
    if (bytes > remaining_.size()) throw Damaged();
    std::memcpy(to, remaining_.data(), bytes);
    remaining_.remove_prefix(bytes);
  }

  std::string file_;
  std::string_view remaining_;
};

}  // namespace tarsier::sfm
