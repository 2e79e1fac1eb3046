// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

// ONNX files as they lie on the disk, looked at before OpenCV sees them: sizes, operators, inputs
// and outputs. The format is protobuf's wire format, of which only what is needed is read.
namespace tarsier::face::onnx {

inline constexpr std::int64_t kMaxBytes = 512LL << 20;  // of a file

struct TensorForm {
  std::string name;
  std::vector<std::int64_t> shape;  // -1: stands open
};

struct NetworkFile {
  std::string path;
  std::string bytes;
  std::string sha256;              // 64 hexadecimal digits
  std::string producer;            // as it calls itself; may be empty
  std::vector<TensorForm> inputs;  // without those that the file itself fills
  std::vector<TensorForm> outputs;
  std::int64_t nodes = 0;
  std::int64_t parameters = 0;  // numbers in tensors of the file
};

// What the bytes hold. Refuses, with the reason: more than kMaxBytes; what is cut off or no
// protobuf; tensors whose data have another length than their shape says, or lie in another file;
// operators that networks of faces do not use (loops, branches, graphs within graphs among them);
// strides, kernels, groups and pads out of range. Throws ModelError(path).
[[nodiscard]] NetworkFile parse_network(std::string bytes, const std::string& path);
// The same of a file. A file that is missing, a folder or unreadable: ModelError.
[[nodiscard]] NetworkFile read_network_file(const std::string& path);

// How a network takes its image, and who allows its use: from FILE.txt beside FILE ("face.onnx.txt"),
// lines `key: value`, `#` begins a comment. Keys:
//   licence   any text
//   size      W or WxH, px, 16..2048: where the file leaves it open
//   mean      one number or one for each channel, taken off the grey levels 0..255; -1000..1000
//   scale     the difference is multiplied by it; above 0, at most 1000
struct InputForm {
  std::string licence;  // empty: unknown
  int width = 0;        // 0: as the file says
  int height = 0;
  std::vector<double> mean{0};
  double scale = 1;
};
inline constexpr std::string_view kUnknownLicence = "unknown: ask who gave it";
// `text` of the file `path`. Throws ModelError(path) for unknown keys and values out of range.
[[nodiscard]] InputForm parse_input_form(std::string_view text, const std::string& path);
// Of a network; the defaults where there is no such file. Throws ModelError.
[[nodiscard]] InputForm read_input_form(const std::string& network_path);

}  // namespace tarsier::face::onnx
