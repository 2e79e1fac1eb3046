// SPDX-License-Identifier: MIT
#include "tarsier/plate/classic/xml_matrix.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

namespace tarsier::plate {
namespace {

bool is_space(char c) { return c == ' ' || c == '\n' || c == '\r' || c == '\t'; }

bool is_name(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
         c == '-';
}

// Scans the text; any unexpected content is an error with its line number.
class Scanner {
 public:
  Scanner(std::string_view text, std::string name) : text_(text), name_(std::move(name)) {}

  [[noreturn]] void fail(const std::string& reason) const {
    const auto line = 1 + std::count(text_.begin(), text_.begin() + at_, '\n');
    throw InputError(name_, fmt::format("line {}: {}", line, reason));
  }

  void skip_space() {
    while (at_ < end() && is_space(peek())) ++at_;
  }

  // Skips spaces, then consumes `expected` if it follows.
  bool take(std::string_view expected) {
    skip_space();
    if (!rest().starts_with(expected)) return false;
    at_ += static_cast<std::ptrdiff_t>(expected.size());
    return true;
  }

  void need(std::string_view expected) {
    if (!take(expected)) fail(fmt::format("'{}' is expected", expected));
  }

  std::string take_name() {
    const std::ptrdiff_t start = at_;
    while (at_ < end() && is_name(peek()) && at_ - start < 100) ++at_;
    if (at_ == start) fail("a name is expected");
    return std::string(
        text_.substr(static_cast<std::size_t>(start), static_cast<std::size_t>(at_ - start)));
  }

  template <typename T>
  T take_number(const char* what) {
    skip_space();
    // Numbers may look like "1." and "+1e-3"; from_chars does not accept a plus.
    if (at_ < end() && peek() == '+') ++at_;
    T value{};
    const std::string_view left = rest();
    const auto [stop, error] = std::from_chars(left.data(), left.data() + left.size(), value);
    if (error != std::errc{}) fail(fmt::format("{} is expected", what));
    at_ += stop - left.data();
    if (at_ < end() && !is_space(peek()) && peek() != '<')
      fail(fmt::format("{} is expected", what));
    return value;
  }

  [[nodiscard]] bool at_end() const { return at_ == end(); }

 private:
  [[nodiscard]] std::ptrdiff_t end() const { return static_cast<std::ptrdiff_t>(text_.size()); }
  [[nodiscard]] char peek() const { return text_[static_cast<std::size_t>(at_)]; }
  [[nodiscard]] std::string_view rest() const {
    return text_.substr(static_cast<std::size_t>(at_));
  }

  std::string_view text_;
  std::string name_;
  std::ptrdiff_t at_ = 0;
};

int take_size(Scanner& scanner, const char* element, int max_size) {
  scanner.need(fmt::format("<{}>", element));
  const int size = scanner.take_number<int>("a whole number");
  if (size < 1 || size > max_size)
    scanner.fail(fmt::format("{} of {}: 1 to {} are allowed", size, element, max_size));
  scanner.need(fmt::format("</{}>", element));
  return size;
}

cv::Mat take_matrix(Scanner& scanner, const XmlLimits& limits, std::int64_t& values) {
  const int rows = take_size(scanner, "rows", limits.max_rows);
  const int cols = take_size(scanner, "cols", limits.max_cols);
  scanner.need("<dt>");
  scanner.skip_space();
  if (const std::string type = scanner.take_name();
      type.size() != 1 || std::string_view("ucwsifd").find(type) == std::string_view::npos) {
    scanner.fail(fmt::format("elements of type '{}': one of u c w s i f d is expected", type));
  }
  scanner.need("</dt>");
  values += std::int64_t{rows} * cols;
  if (values > limits.max_values)
    scanner.fail(fmt::format("more than {} numbers", limits.max_values));
  scanner.need("<data>");
  // Grows with the numbers read: a short file that announces a huge matrix costs no memory.
  std::vector<float> data;
  const auto count = static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols);
  while (data.size() < count) {
    const auto value = scanner.take_number<double>("a number");
    if (!std::isfinite(value) || std::abs(value) > 1e30) scanner.fail("a number is not finite");
    data.push_back(static_cast<float>(value));
  }
  if (!scanner.take("</data>"))
    scanner.fail(fmt::format("more than {} x {} numbers, or no </data>", rows, cols));
  return cv::Mat(data, true).reshape(1, rows).clone();
}

}  // namespace

std::map<std::string, cv::Mat> parse_xml_matrices(std::string_view text, const std::string& name,
                                                  const XmlLimits& limits) {
  TARSIER_REQUIRE(limits.max_rows >= 1 && limits.max_cols >= 1 && limits.max_values >= 1 &&
                      limits.max_matrices >= 1,
                  "limits of {} x {}, {} numbers, {} matrices", limits.max_rows, limits.max_cols,
                  limits.max_values, limits.max_matrices);
  Scanner scanner(text, name);
  if (!scanner.take("<?xml version=\"1.0\"?>"))
    scanner.fail("not XML: <?xml version=\"1.0\"?> is missing");
  scanner.need("<opencv_storage>");
  std::map<std::string, cv::Mat> matrices;
  std::int64_t values = 0;
  while (!scanner.take("</opencv_storage>")) {
    scanner.need("<");
    const std::string element = scanner.take_name();
    if (!scanner.take("type_id=\"opencv-matrix\""))
      scanner.fail(fmt::format("<{}> is not an opencv-matrix", element));
    scanner.need(">");
    if (std::cmp_greater_equal(matrices.size(), limits.max_matrices))
      scanner.fail(fmt::format("more than {} matrices", limits.max_matrices));
    cv::Mat matrix = take_matrix(scanner, limits, values);
    scanner.need(fmt::format("</{}>", element));
    if (!matrices.emplace(element, std::move(matrix)).second)
      scanner.fail(fmt::format("a second <{}>", element));
  }
  scanner.skip_space();
  if (!scanner.at_end()) scanner.fail("text after </opencv_storage>");
  return matrices;
}

std::map<std::string, cv::Mat> read_xml_matrices(const std::string& path, const XmlLimits& limits) {
  return parse_xml_matrices(read_file(path, limits.max_bytes), path, limits);
}

const cv::Mat& matrix_named(const std::map<std::string, cv::Mat>& matrices,
                            const std::string& matrix, const std::string& path) {
  const auto found = matrices.find(matrix);
  if (found != matrices.end()) return found->second;
  std::string known;
  for (const auto& [name, mat] : matrices) known += (known.empty() ? "" : ", ") + name;
  throw InputError(path, fmt::format("no matrix <{}>; there {}", matrix,
                                     known.empty() ? "are none" : "is " + known));
}

}  // namespace tarsier::plate
