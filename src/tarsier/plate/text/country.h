// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

// The plate layouts of countries, read from small text files (models/countries/*.txt). Users can
// add files.
namespace tarsier::plate {

// The symbols allowed at one position of a layout: bit k stands for class k of kAlphabet.
using SymbolSet = std::uint64_t;

// One kind of plate text, e.g. "DDDD LLL", with its own set of letters.
struct Layout {
  std::string country;               // code of the country, from the file name: "es"
  std::string name;                  // "now", "old (province)"
  std::vector<SymbolSet> positions;  // one for each character, without spaces; 2..12
  // Position before which the wide gap or the second row begins; 0 if there is none.
  int group_break = 0;
  double weight = 1;  // frequency relative to the country's other layouts; > 0
  double prior = 1;   // frequency of the country's plates relative to other countries; > 0
  double aspect = 0;  // width / height of its plates with one row; 0 if not known
};

struct Country {
  std::string code;   // "es", lower case letters, digits, '-'
  std::string name;   // "Spain"
  std::string group;  // "eu" etc.: `--country eu` selects the whole group; may be empty
  std::vector<Layout> layouts;
};

// Parses a country file. Its lines:
//   # a comment, also after the other lines
//   name Spain
//   group eu
//   cars 25                           millions; its square root is the country's weight. Default: 1
//   aspect 4.7                        width / height of its plates with one row. Default: any
//   set C = BCDFGHJKLMNPRSTVWXYZ      one letter that stands for any of these in layouts below
//   words P = M B V SE                one letter that stands for any of these words
//   DDDD CCC   weight 10   name now   a layout; weight (1) and name are optional
// In a layout, D is a digit, L a letter and A either of them. [B] and [XYZ] are the symbols
// themselves, and a digit is itself. A '?' makes the position before it optional. A space is the
// gap between groups; a two-row plate breaks at the first gap. A '|' marks the row break if it is
// not at the first gap. Words and optional positions expand one line into several layouts, which
// share its weight.
//
// The code is the file's name without its folder and extension. `name` is the file name, also used
// in errors. Throws InputError with the line number.
[[nodiscard]] Country parse_country(std::string_view text, const std::string& name);

// Reads the countries of *.txt in `folder`, sorted by code. Throws InputError for a bad file.
[[nodiscard]] std::vector<Country> read_countries(const std::string& folder);

// Selects the countries that `wanted` names by code or group. With "any" or an empty list, all
// countries are selected and free texts are allowed. Throws UsageError for an unknown code; it
// names the nearest known code.
struct CountryChoice {
  std::vector<Layout> layouts;
  bool free_text = false;  // allows texts that fit no layout, with a penalty
};
[[nodiscard]] CountryChoice choose_countries(const std::vector<Country>& countries,
                                             const std::vector<std::string>& requested);

// The width / height of a plate of one row.
enum class AspectRange {
  kLong,         // above 3.7: neither a 2:1 nor a 3:1 plate
  kMedium,       // above 2.7: not a 2:1 plate; a 4.7:1 plate only if seen from the side
  kMediumShort,  // a 2:1 or 3:1 plate, hardly a 4.7:1 plate
  kShort         // below 2.3: hardly a 4.7:1 plate
};
[[nodiscard]] AspectRange aspect_range(double aspect);
[[nodiscard]] CountryChoice weighted_by_aspect(CountryChoice choice, AspectRange range);

}  // namespace tarsier::plate
