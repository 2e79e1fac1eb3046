// SPDX-License-Identifier: MIT
#include "tarsier/face/onnx/network_file.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/sha256.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <system_error>

namespace tarsier::face::onnx {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kMaxNodes = 20'000;
constexpr std::int64_t kMaxSide = 1LL << 28;  // of a tensor
constexpr std::size_t kMaxNameBytes = 200;    // bytes

// Operators of networks that detect and compare faces.
constexpr auto kOperators = std::to_array<std::string_view>({"Add",
                                                             "AveragePool",
                                                             "BatchNormalization",
                                                             "Cast",
                                                             "Clip",
                                                             "Concat",
                                                             "Constant",
                                                             "Conv",
                                                             "ConvTranspose",
                                                             "Div",
                                                             "Dropout",
                                                             "Elu",
                                                             "Exp",
                                                             "Flatten",
                                                             "Gather",
                                                             "Gemm",
                                                             "GlobalAveragePool",
                                                             "GlobalMaxPool",
                                                             "HardSigmoid",
                                                             "HardSwish",
                                                             "Identity",
                                                             "InstanceNormalization",
                                                             "LeakyRelu",
                                                             "LpNormalization",
                                                             "MatMul",
                                                             "Max",
                                                             "MaxPool",
                                                             "Min",
                                                             "Mul",
                                                             "Neg",
                                                             "PRelu",
                                                             "Pad",
                                                             "Pow",
                                                             "ReduceL2",
                                                             "ReduceMean",
                                                             "ReduceSum",
                                                             "Relu",
                                                             "Reshape",
                                                             "Resize",
                                                             "Shape",
                                                             "Sigmoid",
                                                             "Slice",
                                                             "Softmax",
                                                             "Split",
                                                             "Sqrt",
                                                             "Squeeze",
                                                             "Sub",
                                                             "Tanh",
                                                             "Transpose",
                                                             "Unsqueeze",
                                                             "Upsample"});

// One field of a message.
struct Field {
  std::uint32_t number = 0;
  std::uint32_t wire = 0;   // 0 varint, 1 eight bytes, 2 bytes, 5 four bytes
  std::uint64_t value = 0;  // of a varint
  std::string_view bytes;   // of the others
};

// Reads the fields of a message in order.
class Fields {
 public:
  Fields(std::string_view bytes, const std::string& path) : bytes_(bytes), path_(&path) {}

  bool next(Field& field) {
    if (bytes_.empty()) return false;
    const std::uint64_t key = varint();
    field.number = static_cast<std::uint32_t>(key >> 3);
    field.wire = static_cast<std::uint32_t>(key & 7);
    if (field.number == 0 || key >> 32 != 0) fail("is damaged, or no ONNX file");
    field.value = 0;
    field.bytes = {};
    switch (field.wire) {
      case 0:
        field.value = varint();
        break;
      case 1:
        field.bytes = take(8);
        break;
      case 2:
        field.bytes = take(varint());
        break;
      case 5:
        field.bytes = take(4);
        break;
      default:
        fail("is damaged, or no ONNX file");
    }
    return true;
  }
  std::uint64_t varint() {
    std::uint64_t value = 0;
    for (unsigned shift = 0; shift < 64; shift += 7) {
      if (bytes_.empty()) fail("is cut off, or no ONNX file");
      const auto byte = static_cast<unsigned char>(bytes_.front());
      bytes_.remove_prefix(1);
      value |= static_cast<std::uint64_t>(byte & 0x7FU) << shift;
      if (byte < 0x80) return value;
    }
    fail("is damaged, or no ONNX file");
  }
  [[nodiscard]] bool empty() const { return bytes_.empty(); }
  [[noreturn]] void fail(const std::string& reason) const { throw ModelError(*path_, reason); }

 private:
  std::string_view take(std::uint64_t size) {
    if (size > bytes_.size()) fail("is cut off, or no ONNX file");
    const std::string_view out = bytes_.substr(0, size);
    bytes_.remove_prefix(size);
    return out;
  }
  std::string_view bytes_;
  const std::string* path_;
};

std::string name_of(const Field& field) {
  std::string out;
  for (const char letter : field.bytes.substr(0, kMaxNameBytes))
    out += static_cast<unsigned char>(letter) < ' ' ? '?' : letter;
  return out;
}

// Adds the integers of a field, which may be packed.
void add_integers(const Field& field, const std::string& path, std::vector<std::int64_t>& out) {
  constexpr std::size_t kMax = 1024;
  if (field.wire == 0) {
    out.push_back(static_cast<std::int64_t>(field.value));
  } else if (field.wire == 2) {
    for (Fields packed(field.bytes, path); !packed.empty() && out.size() <= kMax;)
      out.push_back(static_cast<std::int64_t>(packed.varint()));
  }
  if (out.size() > kMax) throw ModelError(path, "a list of more than 1024 numbers");
}

// Size in bytes of an ONNX data type; 0: not supported.
std::int64_t bytes_of(std::uint64_t type) {
  switch (type) {
    case 1:  // float
    case 6:  // int32
      return 4;
    case 7:   // int64
    case 11:  // double
      return 8;
    case 2:  // uint8
    case 3:  // int8
    case 9:  // bool
      return 1;
    case 10:  // float16
      return 2;
    default:
      return 0;
  }
}

class Reader {
 public:
  explicit Reader(NetworkFile& out) : out_(out) {}

  void model() {
    bool graph_seen = false;
    Field field;
    for (Fields fields(out_.bytes, out_.path); fields.next(field);) {
      if (field.number == 2 && field.wire == 2) out_.producer = name_of(field);
      if (field.number != 7) continue;
      if (field.wire != 2 || graph_seen) fail("is damaged, or no ONNX file");
      graph_seen = true;
      graph(field.bytes);
    }
    if (!graph_seen) fail("holds no network: no ONNX file?");
    if (out_.nodes == 0) fail("holds a network without layers");
    std::erase_if(out_.inputs,
                  [&](const TensorInfo& one) { return initialised_.contains(one.name); });
  }

 private:
  [[noreturn]] void fail(const std::string& reason) const { throw ModelError(out_.path, reason); }

  void graph(std::string_view bytes) {
    Field field;
    for (Fields fields(bytes, out_.path); fields.next(field);) {
      if (field.number == 15) fail("holds sparse tensors, which are not taken");
      if (field.wire != 2) continue;
      if (field.number == 1) node(field.bytes);
      if (field.number == 5) initialised_.insert(tensor(field.bytes));
      if (field.number == 11) out_.inputs.push_back(tensor_info(field.bytes));
      if (field.number == 12) out_.outputs.push_back(tensor_info(field.bytes));
    }
  }

  void node(std::string_view bytes) {
    if (++out_.nodes > kMaxNodes) fail(fmt::format("has more than {} layers", kMaxNodes));
    std::string kind;
    Field field;
    for (Fields fields(bytes, out_.path); fields.next(field);)
      if (field.number == 4 && field.wire == 2) kind = name_of(field);
    if (!std::binary_search(kOperators.begin(), kOperators.end(), kind))
      fail(fmt::format("has a layer '{}', which networks of faces do without", kind));
    for (Fields fields(bytes, out_.path); fields.next(field);)
      if (field.number == 5 && field.wire == 2) attribute(field.bytes, kind);
  }

  void attribute(std::string_view bytes, const std::string& kind) {
    std::string name;
    std::vector<std::int64_t> numbers;
    Field field;
    for (Fields fields(bytes, out_.path); fields.next(field);) {
      if (field.number == 1 && field.wire == 2) name = name_of(field);
      if (field.number == 3 || field.number == 8) add_integers(field, out_.path, numbers);
      if (field.number == 5 && field.wire == 2) (void)tensor(field.bytes);
      if (field.number == 6 || field.number == 11)
        fail(fmt::format("'{}' holds a network of its own, which is not taken", kind));
    }
    constexpr std::int64_t kMax = 65'536;
    const bool positive =
        name == "group" || name == "strides" || name == "dilations" || name == "kernel_shape";
    if (!positive && name != "pads") return;
    for (const std::int64_t number : numbers)
      if (number < (positive ? 1 : 0) || number > kMax)
        fail(fmt::format("'{}': {} of {}", kind, name, number));
  }

  // Returns the tensor's name.
  std::string tensor(std::string_view bytes) {
    std::string name;
    std::vector<std::int64_t> shape;
    std::uint64_t type = 0;
    std::int64_t raw = -1;   // bytes
    std::int64_t typed = 0;  // numbers
    Field field;
    for (Fields fields(bytes, out_.path); fields.next(field);) {
      switch (field.number) {
        case 1:
          add_integers(field, out_.path, shape);
          break;
        case 2:
          type = field.value;
          break;
        case 4:  // float_data
          typed += field.wire == 2 ? static_cast<std::int64_t>(field.bytes.size()) / 4 : 1;
          break;
        case 10:  // double_data
          typed += field.wire == 2 ? static_cast<std::int64_t>(field.bytes.size()) / 8 : 1;
          break;
        case 5:  // int32_data
        case 7:  // int64_data
          typed +=
              field.wire == 2
                  ? std::count_if(field.bytes.begin(), field.bytes.end(),
                                  [](char byte) { return static_cast<unsigned char>(byte) < 0x80; })
                  : 1;
          break;
        case 8:
          name = name_of(field);
          break;
        case 9:
          raw = static_cast<std::int64_t>(field.bytes.size());
          break;
        case 13:
          fail(fmt::format("'{}' lies in another file, which is not taken", name));
        case 14:
          if (field.value != 0)
            fail(fmt::format("'{}' lies in another file, which is not taken", name));
          break;
        default:
          break;
      }
    }
    const std::int64_t width = bytes_of(type);
    if (width == 0)
      fail(fmt::format("'{}' has numbers of type {}, which is not taken", name, type));
    std::int64_t count = 1;
    if (shape.size() > 8) fail(fmt::format("'{}' has {} dimensions", name, shape.size()));
    for (const std::int64_t side : shape) {
      if (side < 0 || side > kMaxSide) fail(fmt::format("'{}' has a side of {}", name, side));
      count *= side;
      if (count > kMaxBytes) fail(fmt::format("'{}' is larger than the file", name));
    }
    const bool fits = raw >= 0 ? raw == count * width && typed == 0 : typed == count;
    if (!fits) fail(fmt::format("'{}' has another length than its shape says", name));
    out_.parameters += count;
    return name;
  }

  [[nodiscard]] TensorInfo tensor_info(std::string_view bytes) const {
    TensorInfo out;
    Field field;
    for (Fields fields(bytes, out_.path); fields.next(field);) {
      if (field.wire != 2) continue;
      if (field.number == 1) out.name = name_of(field);
      if (field.number != 2) continue;
      Field type;
      for (Fields types(field.bytes, out_.path); types.next(type);) {
        if (type.number != 1 || type.wire != 2) continue;
        Field part;
        for (Fields parts(type.bytes, out_.path); parts.next(part);) {
          if (part.number == 1 && part.value != 1)
            fail(fmt::format("'{}' is not of floats", out.name));
          if (part.number == 2 && part.wire == 2) out.shape = sides(part.bytes);
        }
      }
    }
    return out;
  }

  [[nodiscard]] std::vector<std::int64_t> sides(std::string_view bytes) const {
    std::vector<std::int64_t> out;
    Field field;
    for (Fields fields(bytes, out_.path); fields.next(field);) {
      if (field.number != 1 || field.wire != 2) continue;
      std::int64_t side = -1;
      Field part;
      for (Fields parts(field.bytes, out_.path); parts.next(part);)
        if (part.number == 1) side = static_cast<std::int64_t>(part.value);
      if (side < -1 || side > kMaxSide) fail(fmt::format("a side of {}", side));
      out.push_back(side == 0 ? -1 : side);
      if (out.size() > 8) fail("an input or output of more than 8 dimensions");
    }
    return out;
  }

  NetworkFile& out_;
  std::set<std::string> initialised_;
};

std::string read_bytes(const std::string& path, std::int64_t max_bytes) {
  std::error_code error;
  if (fs::is_directory(path, error)) throw ModelError(path, "is a folder");
  const auto size = fs::file_size(path, error);
  if (error) throw ModelError(path, "cannot be read: " + error.message());
  if (size > static_cast<std::uintmax_t>(max_bytes))
    throw ModelError(path, fmt::format("is larger than {} bytes", max_bytes));
  std::ifstream file(path, std::ios::binary);
  std::string bytes(size, '\0');
  if (!file.read(bytes.data(), static_cast<std::streamsize>(size)))
    throw ModelError(path, "cannot be read");
  return bytes;
}

std::string_view trimmed(std::string_view text) {
  const auto is_space = [](char letter) {
    return std::isspace(static_cast<unsigned char>(letter)) != 0;
  };
  while (!text.empty() && is_space(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_space(text.back())) text.remove_suffix(1);
  return text;
}

std::optional<double> number_of(std::string_view text, double low, double high) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !(value >= low && value <= high))
    return std::nullopt;
  return value;
}

}  // namespace

NetworkFile parse_network(std::string bytes, const std::string& path) {
  NetworkFile out;
  out.path = path;
  if (static_cast<std::int64_t>(bytes.size()) > kMaxBytes)
    throw ModelError(path, fmt::format("is larger than {} bytes", kMaxBytes));
  out.bytes = std::move(bytes);
  Reader(out).model();
  Sha256 sum;
  sum.add(out.bytes);
  out.sha256 = sum.hex();
  return out;
}

NetworkFile read_network_file(const std::string& path) {
  return parse_network(read_bytes(path, kMaxBytes), path);
}

InputFormat parse_input_format(std::string_view text, const std::string& path) {
  InputFormat out;
  int number = 0;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    ++number;
    line = trimmed(line);
    if (line.empty() || line.front() == '#') continue;
    const std::size_t colon = std::min(line.find(':'), line.size());
    const std::string_view key = trimmed(line.substr(0, colon));
    const std::string_view value = trimmed(line.substr(std::min(colon + 1, line.size())));
    const auto fail = [&](const std::string& wanted) {
      throw ModelError(path, fmt::format("line {}: {}", number, wanted));
    };
    if (key == "licence") {
      for (const char letter : value.substr(0, kMaxNameBytes))
        out.licence += static_cast<unsigned char>(letter) < ' ' ? '?' : letter;
    } else if (key == "size") {
      const std::size_t cross = std::min(value.find('x'), value.size());
      const auto width = number_of(value.substr(0, cross), 16, 2048);
      const auto height =
          cross < value.size() ? number_of(value.substr(cross + 1), 16, 2048) : width;
      if (!width || !height) fail("size is W or WxH, 16 to 2048 px");
      out.width = static_cast<int>(*width);
      out.height = static_cast<int>(*height);
    } else if (key == "mean") {
      out.mean.clear();
      std::string_view rest = value;
      while (!rest.empty() && out.mean.size() < 4) {
        const std::size_t gap = std::min(rest.find(' '), rest.size());
        const auto mean = number_of(rest.substr(0, gap), -1000, 1000);
        if (!mean) break;
        out.mean.push_back(*mean);
        rest = trimmed(rest.substr(gap));
      }
      if (!rest.empty() || (out.mean.size() != 1 && out.mean.size() != 3))
        fail("mean is one number or three, -1000 to 1000");
    } else if (key == "scale") {
      const auto scale = number_of(value, 1e-9, 1000);
      if (!scale) fail("scale is a number above 0, at most 1000");
      out.scale = *scale;
    } else {
      fail(fmt::format("unknown word '{}': licence, size, mean or scale",
                       std::string(key.substr(0, 40))));
    }
  }
  return out;
}

InputFormat read_input_format(const std::string& network_path) {
  constexpr std::int64_t kMax = 65'536;
  const std::string path = network_path + ".txt";
  std::error_code error;
  if (!fs::exists(path, error)) return {};
  return parse_input_format(read_bytes(path, kMax), path);
}

}  // namespace tarsier::face::onnx
