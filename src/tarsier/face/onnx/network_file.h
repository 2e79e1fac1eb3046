// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

// Checks ONNX files before OpenCV reads them: sizes, operators, inputs and outputs. The format is
// protobuf's wire format; only the necessary part is read.
namespace tarsier::face::onnx {

inline constexpr std::int64_t kMaxBytes = 512LL << 20;  // max size of a file

struct TensorInfo {
  std::string name;
  std::vector<std::int64_t> shape;  // -1: variable
};

struct NetworkFile {
  std::string path;
  std::string bytes;
  std::string sha256;              // 64 hexadecimal digits
  std::string producer;            // producer name in the file; may be empty
  std::vector<TensorInfo> inputs;  // without inputs that have an initial value in the file
  std::vector<TensorInfo> outputs;
  std::int64_t nodes = 0;
  std::int64_t parameters = 0;  // elements of tensors in the file
};

// Parses the bytes. Throws ModelError(path) with the reason for: more than kMaxBytes; truncated
// data or no protobuf; tensors whose data have another length than their shape, or are in another
// file; operators that face networks do not use (including loops, branches and nested graphs);
// strides, kernels, groups and pads out of range.
[[nodiscard]] NetworkFile parse_network(std::string bytes, const std::string& path);
// The same for a file. Also throws ModelError if it is missing, a folder or unreadable.
[[nodiscard]] NetworkFile read_network_file(const std::string& path);

// The input format and licence of a network, from FILE.txt in the folder of FILE ("face.onnx.txt"):
// lines `key: value`; `#` begins a comment. Keys:
//   licence   any text
//   size      W or WxH, px, 16..2048: if the file does not fix it
//   mean      one number or one per channel, subtracted from grey levels 0..255; -1000..1000
//   scale     factor of the difference; above 0, at most 1000
struct InputFormat {
  std::string licence;  // empty: unknown
  int width = 0;        // 0: as in the network's file
  int height = 0;
  std::vector<double> mean{0};
  double scale = 1;
};
inline constexpr std::string_view kUnknownLicence = "unknown: ask who gave it";
// `text` of the file `path`. Throws ModelError(path) for unknown keys and values out of range.
[[nodiscard]] InputFormat parse_input_format(std::string_view text, const std::string& path);
// For a network; the defaults if there is no such file. Throws ModelError.
[[nodiscard]] InputFormat read_input_format(const std::string& network_path);

}  // namespace tarsier::face::onnx
