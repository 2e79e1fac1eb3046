// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

// What the plates of a country look like: read from small text files (countries/*.txt below
// models/) that a user can add to.
namespace tarsier::plate {

// One position of a layout: the symbols that may stand there, bit k for class k of kAlphabet.
using SymbolSet = std::uint64_t;

// One kind of plate text, e.g. "DDDD LLL" with its own letters.
struct Layout {
  std::string country;            // code of the file: "es"
  std::string name;               // "now", "old (province)"
  std::vector<SymbolSet> places;  // one for each character, without spaces; 2..12
  int group_break = 0;            // place before which the wide gap or second row begins; 0: none
  double weight = 1;              // how common it is, relative to the others of the country; > 0
  double prior = 1;               // how common the country's plates are, relative to others'; > 0
  double aspect = 0;              // width by height of its plates with one row; 0: not known
};

struct Country {
  std::string code;   // "es", lower case letters, digits, '-'
  std::string name;   // "Spain"
  std::string group;  // "eu" etc.: `--country eu` takes all of the group; may be empty
  std::vector<Layout> layouts;
};

// Parses a country file. Its lines:
//   # a comment, also after the other lines
//   name Spain
//   group eu
//   cars 25                           millions; its square root counts among countries. Default: 1
//   aspect 4.7                        width by height of its plates with one row. Default: any
//   set C = BCDFGHJKLMNPRSTVWXYZ      one letter that stands for any of these in layouts below
//   words P = M B V SE                one letter that stands for any of these words
//   DDDD CCC   weight 10   name now   a layout; weight (1) and name may be left out
// In a layout D is a digit, L a letter, A either, [B] or [XYZ] the symbols themselves, a digit
// itself; a '?' makes the place before it optional, and a space is the gap between groups, where
// two-row plates break ('|' instead marks the row break where that is not the first gap). Words and
// optional places make several layouts of one line, which share its weight. The code is the file's
// name without its folder and ending. `name` is the file, also for errors. Throws InputError with
// the line number.
[[nodiscard]] Country parse_country(std::string_view text, const std::string& name);

// The countries of *.txt in `folder`, by code. Throws InputError for a bad file.
[[nodiscard]] std::vector<Country> read_countries(const std::string& folder);

// Those that `wanted` names by code or group; "any" or an empty list: all, plus texts of no
// layout. Throws UsageError naming the nearest known code for an unknown one.
struct CountryChoice {
  std::vector<Layout> layouts;
  bool free_text = false;  // texts that no layout fits are allowed, at a price
};
[[nodiscard]] CountryChoice choose_countries(const std::vector<Country>& countries,
                                             const std::vector<std::string>& wanted);

// The same layouts, those less likely that a plate of one row with this form does not have.
enum class PlateForm {
  kLong,    // wider than 3.7 times its height: neither a plate of 2:1 nor one of 3:1
  kMiddle,  // wider than 2.7 times: not one of 2:1; one of 4.7:1 only where it is seen from the side
  kBetween,  // one of 2:1 or 3:1, hardly one of 4.7:1
  kShort     // narrower than 2.3 times its height: hardly one of 4.7:1
};
[[nodiscard]] PlateForm plate_form(double aspect);
[[nodiscard]] CountryChoice weighed_by_form(CountryChoice choice, PlateForm form);

}  // namespace tarsier::plate
