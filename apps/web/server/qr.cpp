// SPDX-License-Identifier: MIT
#include "qr.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>

namespace tarsier::web {
namespace {

struct Version {
  int data = 0;  // codewords of all blocks
  int ec = 0;    // error correction codewords per block
  int blocks = 0;
  std::array<int, 3> alignment{};  // centres of alignment patterns; 0: none
};
// Level L (tables 7, 9 and E.1 of the standard).
constexpr std::array<Version, 10> kVersions{{{19, 7, 1, {}},
                                             {34, 10, 1, {6, 18}},
                                             {55, 15, 1, {6, 22}},
                                             {80, 20, 1, {6, 26}},
                                             {108, 26, 1, {6, 30}},
                                             {136, 18, 2, {6, 34}},
                                             {156, 20, 2, {6, 22, 38}},
                                             {194, 24, 2, {6, 24, 42}},
                                             {232, 30, 2, {6, 26, 46}},
                                             {274, 18, 4, {6, 28, 50}}}};

using Bytes = std::vector<std::uint8_t>;

// Multiplication in GF(256) with x^8 + x^4 + x^3 + x^2 + 1.
std::uint8_t times(std::uint8_t a, std::uint8_t b) {
  unsigned product = 0;
  for (int bit = 7; bit >= 0; --bit) {
    product = (product << 1U) ^ ((product >> 7U) * 0x11dU);
    product ^= ((static_cast<unsigned>(b) >> static_cast<unsigned>(bit)) & 1U) * a;
  }
  return static_cast<std::uint8_t>(product);
}

class Bits {
 public:
  void put(unsigned value, int count) {
    for (int bit = count - 1; bit >= 0; --bit)
      bits_.push_back(((value >> static_cast<unsigned>(bit)) & 1U) != 0);
  }
  [[nodiscard]] std::size_t size() const { return bits_.size(); }
  [[nodiscard]] Bytes bytes() const {
    Bytes result((bits_.size() + 7) / 8);
    for (std::size_t i = 0; i < bits_.size(); ++i) {
      if (bits_[i]) result[i / 8] = static_cast<std::uint8_t>(result[i / 8] | (0x80U >> (i % 8)));
    }
    return result;
  }

 private:
  std::vector<bool> bits_;
};

// The padded data in blocks with their error correction, interleaved.
Bytes codewords_of(std::string_view text, int number) {
  const Version& version = kVersions[static_cast<std::size_t>(number - 1)];
  Bits bits;
  bits.put(4, 4);  // byte mode
  bits.put(static_cast<unsigned>(text.size()), number < 10 ? 8 : 16);
  for (const char c : text) bits.put(static_cast<unsigned char>(c), 8);
  const auto room = static_cast<std::size_t>(version.data) * 8;
  bits.put(0, static_cast<int>(std::min<std::size_t>(4, room - bits.size())));
  bits.put(0, static_cast<int>((8 - bits.size() % 8) % 8));
  for (unsigned pad = 0xec; bits.size() < room; pad ^= 0xecU ^ 0x11U) bits.put(pad, 8);
  const Bytes data = bits.bytes();

  // If the data cannot be divided evenly, the later blocks have one more codeword.
  const int shortest = version.data / version.blocks;
  const int longer = version.data % version.blocks;
  std::vector<Bytes> blocks;
  std::vector<Bytes> corrections;
  auto at = data.begin();
  for (int i = 0; i < version.blocks; ++i) {
    const int length = shortest + (i >= version.blocks - longer ? 1 : 0);
    blocks.emplace_back(at, at + length);
    corrections.push_back(qr_error_correction(blocks.back(), version.ec));
    at += length;
  }
  Bytes result;
  for (int i = 0; i <= shortest; ++i) {
    for (const Bytes& block : blocks) {
      if (static_cast<std::size_t>(i) < block.size())
        result.push_back(block[static_cast<std::size_t>(i)]);
    }
  }
  for (int i = 0; i < version.ec; ++i) {
    for (const Bytes& block : corrections) result.push_back(block[static_cast<std::size_t>(i)]);
  }
  return result;
}

bool is_masked(int mask, int row, int column) {
  switch (mask) {
    case 0:
      return (row + column) % 2 == 0;
    case 1:
      return row % 2 == 0;
    case 2:
      return column % 3 == 0;
    case 3:
      return (row + column) % 3 == 0;
    case 4:
      return (row / 2 + column / 3) % 2 == 0;
    case 5:
      return row * column % 2 + row * column % 3 == 0;
    case 6:
      return (row * column % 2 + row * column % 3) % 2 == 0;
    default:
      return ((row + column) % 2 + row * column % 3) % 2 == 0;
  }
}

class Drawing {
 public:
  explicit Drawing(int number) : number_(number) {
    code_.size = 17 + 4 * number;
    code_.is_dark.assign(static_cast<std::size_t>(code_.size * code_.size), false);
    is_function_ = code_.is_dark;
    draw_functions();
  }

  void put_data(const Bytes& codewords) {
    std::size_t bit = 0;
    bool upwards = true;
    // Two columns at a time from the right; the timing column is skipped.
    for (int right = code_.size - 1; right > 0; right -= 2) {
      if (right == 6) right = 5;
      for (int i = 0; i < code_.size; ++i) {
        const int row = upwards ? code_.size - 1 - i : i;
        for (int column = right; column > right - 2; --column) {
          if (is_function_[index(row, column)]) continue;
          if (bit < codewords.size() * 8 &&
              ((static_cast<unsigned>(codewords[bit / 8]) >> (7 - bit % 8)) & 1U) != 0)
            code_.is_dark[index(row, column)] = true;
          ++bit;
        }
      }
      upwards = !upwards;
    }
  }

  [[nodiscard]] QrCode masked(int mask) const {
    Drawing result = *this;
    for (int row = 0; row < code_.size; ++row) {
      for (int column = 0; column < code_.size; ++column) {
        if (!is_function_[index(row, column)] && is_masked(mask, row, column))
          result.code_.is_dark[index(row, column)].flip();
      }
    }
    result.put_format(qr_format_bits(mask));
    return result.code_;
  }

 private:
  [[nodiscard]] std::size_t index(int row, int column) const {
    return static_cast<std::size_t>(row * code_.size + column);
  }
  void put(int row, int column, bool is_dark) {
    if (row < 0 || column < 0 || row >= code_.size || column >= code_.size) return;
    code_.is_dark[index(row, column)] = is_dark;
    is_function_[index(row, column)] = true;
  }

  void draw_functions() {
    const int last = code_.size - 1;
    for (int i = 0; i < code_.size; ++i) {
      put(6, i, i % 2 == 0);
      put(i, 6, i % 2 == 0);
    }
    for (const auto& [row, column] : {std::pair{3, 3}, {3, last - 3}, {last - 3, 3}}) {
      for (int y = -4; y <= 4; ++y) {
        for (int x = -4; x <= 4; ++x) {
          const int ring = std::max(std::abs(x), std::abs(y));
          put(row + y, column + x, ring != 2 && ring != 4);
        }
      }
    }
    const auto& centres = kVersions[static_cast<std::size_t>(number_ - 1)].alignment;
    for (const int row : centres) {
      for (const int column : centres) {
        const bool in_corner = (row == 6 && column == 6) || (row == 6 && column == last - 6) ||
                               (row == last - 6 && column == 6);
        if (row == 0 || column == 0 || in_corner) continue;
        for (int y = -2; y <= 2; ++y) {
          for (int x = -2; x <= 2; ++x)
            put(row + y, column + x, std::max(std::abs(x), std::abs(y)) != 1);
        }
      }
    }
    put_format(0);  // reserves the place
    if (number_ >= 7) {
      const unsigned bits = qr_version_bits(number_);
      for (int i = 0; i < 18; ++i) {
        const bool is_dark = ((bits >> static_cast<unsigned>(i)) & 1U) != 0;
        put(code_.size - 11 + i % 3, i / 3, is_dark);
        put(i / 3, code_.size - 11 + i % 3, is_dark);
      }
    }
  }

  void put_format(unsigned bits) {
    const auto bit = [&](int i) { return ((bits >> static_cast<unsigned>(i)) & 1U) != 0; };
    const int size = code_.size;
    for (int i = 0; i <= 5; ++i) put(i, 8, bit(i));
    put(7, 8, bit(6));
    put(8, 8, bit(7));
    put(8, 7, bit(8));
    for (int i = 9; i < 15; ++i) put(8, 14 - i, bit(i));
    for (int i = 0; i < 8; ++i) put(8, size - 1 - i, bit(i));
    for (int i = 8; i < 15; ++i) put(size - 15 + i, 8, bit(i));
    put(size - 8, 8, true);
  }

  int number_;
  QrCode code_;
  std::vector<bool> is_function_;
};

// The four penalty rules of the standard.
int penalty_of(const QrCode& code) {
  int penalty = 0;
  int dark = 0;
  constexpr std::array<bool, 11> kLikeFinder{true, false, true,  true,  true, false,
                                             true, false, false, false, false};
  for (const bool by_rows : {true, false}) {
    const auto at = [&](int line, int i) { return by_rows ? code.at(line, i) : code.at(i, line); };
    for (int line = 0; line < code.size; ++line) {
      int run = 0;
      for (int i = 0; i < code.size; ++i) {
        run = i > 0 && at(line, i) == at(line, i - 1) ? run + 1 : 1;
        if (run == 5) penalty += 3;
        if (run > 5) ++penalty;
        if (i + 11 > code.size) continue;
        bool forwards = true;
        bool backwards = true;
        for (int k = 0; k < 11; ++k) {
          const bool module = at(line, i + k);
          forwards = forwards && module == kLikeFinder[static_cast<std::size_t>(k)];
          backwards = backwards && module == kLikeFinder[static_cast<std::size_t>(10 - k)];
        }
        penalty += forwards || backwards ? 40 : 0;
      }
    }
  }
  for (int row = 0; row < code.size; ++row) {
    for (int column = 0; column < code.size; ++column) {
      const bool module = code.at(row, column);
      dark += module ? 1 : 0;
      if (row + 1 < code.size && column + 1 < code.size && module == code.at(row, column + 1) &&
          module == code.at(row + 1, column) && module == code.at(row + 1, column + 1))
        penalty += 3;
    }
  }
  const int percent = 100 * dark / (code.size * code.size);
  return penalty + std::abs(percent - 50) / 5 * 10;
}

}  // namespace

std::vector<std::uint8_t> qr_error_correction(const std::vector<std::uint8_t>& data, int count) {
  // The generator (x - 1)(x - 2)(x - 4) .. without its leading 1.
  Bytes generator(static_cast<std::size_t>(count), 0);
  generator.back() = 1;
  std::uint8_t root = 1;
  for (int i = 0; i < count; ++i) {
    for (std::size_t k = 0; k < generator.size(); ++k) {
      generator[k] = times(generator[k], root);
      if (k + 1 < generator.size())
        generator[k] = static_cast<std::uint8_t>(generator[k] ^ generator[k + 1]);
    }
    root = times(root, 2);
  }
  Bytes rest(static_cast<std::size_t>(count), 0);
  for (const std::uint8_t byte : data) {
    const auto factor = static_cast<std::uint8_t>(byte ^ rest.front());
    rest.erase(rest.begin());
    rest.push_back(0);
    for (std::size_t k = 0; k < rest.size(); ++k)
      rest[k] = static_cast<std::uint8_t>(rest[k] ^ times(generator[k], factor));
  }
  return rest;
}

unsigned qr_format_bits(int mask) {
  const unsigned data = (1U << 3U) | static_cast<unsigned>(mask);  // level L
  unsigned rest = data;
  for (int i = 0; i < 10; ++i) rest = (rest << 1U) ^ ((rest >> 9U) * 0x537U);
  return ((data << 10U) | rest) ^ 0x5412U;
}

unsigned qr_version_bits(int version) {
  const auto data = static_cast<unsigned>(version);
  unsigned rest = data;
  for (int i = 0; i < 12; ++i) rest = (rest << 1U) ^ ((rest >> 11U) * 0x1f25U);
  return (data << 12U) | rest;
}

QrCode make_qr_code(std::string_view bytes) {
  int number = 1;
  const auto capacity = [](int version) {
    return kVersions[static_cast<std::size_t>(version - 1)].data - (version < 10 ? 2 : 3);
  };
  while (number < 10 && static_cast<std::size_t>(capacity(number)) < bytes.size()) ++number;
  TARSIER_REQUIRE(bytes.size() <= static_cast<std::size_t>(capacity(number)),
                  "{} bytes are too many", bytes.size());
  Drawing drawing(number);
  drawing.put_data(codewords_of(bytes, number));
  QrCode best;
  int least = 0;
  for (int mask = 0; mask < 8; ++mask) {
    QrCode code = drawing.masked(mask);
    const int penalty = penalty_of(code);
    if (mask == 0 || penalty < least) {
      least = penalty;
      best = std::move(code);
    }
  }
  return best;
}

std::string draw_qr_code(const QrCode& code) {
  constexpr int kQuietZone = 2;
  std::string text;
  const auto is_light = [&](int row, int column) {
    const bool inside = row >= 0 && column >= 0 && row < code.size && column < code.size;
    return !inside || !code.at(row, column);
  };
  for (int row = -kQuietZone; row < code.size + kQuietZone; row += 2) {
    // White on black, independent of the terminal's colours.
    text += "\x1b[37;40m";
    for (int column = -kQuietZone; column < code.size + kQuietZone; ++column) {
      const bool upper = is_light(row, column);
      const bool lower = row + 1 < code.size + kQuietZone && is_light(row + 1, column);
      text += upper ? (lower ? "\u2588" : "\u2580") : (lower ? "\u2584" : " ");
    }
    text += "\x1b[0m\n";
  }
  return text;
}

}  // namespace tarsier::web
