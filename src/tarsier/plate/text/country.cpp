// SPDX-License-Identifier: MIT
#include "tarsier/plate/text/country.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"
#include "tarsier/media/image_file.h"
#include "tarsier/plate/text/beam_search.h"
#include "tarsier/plate/text/reading.h"
#include "tarsier/plate/text/text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <map>
#include <set>
#include <system_error>

namespace tarsier::plate {
namespace {

constexpr SymbolSet kDigits = (SymbolSet{1} << 10U) - 1;
constexpr SymbolSet kLetters = ((SymbolSet{1} << 26U) - 1) << 10U;
constexpr std::size_t kMaxFileBytes = 100'000;
constexpr std::size_t kMaxFileLayouts = 1000;  // per file
constexpr std::size_t kMinPositions = 2;

SymbolSet set_of(char symbol) { return SymbolSet{1} << static_cast<unsigned>(class_of(symbol)); }

bool is_code(std::string_view text) {
  return !text.empty() && text.size() <= 16 && std::all_of(text.begin(), text.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-';
  });
}

// One expansion of an element of a layout: its positions, and its share of the weight.
struct Alternative {
  std::vector<SymbolSet> positions;
  double share = 1;
};
using Element = std::vector<Alternative>;

// Combines words into a minimum number of runs that stand for exactly these words. First, words of
// one length that differ only in the last symbol are merged, then runs that differ only in the
// first.
Element element_of_words(const std::set<std::string>& words) {
  std::map<std::string, SymbolSet> last_of;  // keyed by all but the last symbol
  for (const std::string& word : words) {
    last_of[word.substr(0, word.size() - 1)] |= set_of(word.back());
  }
  // Keyed by the middle and the last symbol.
  std::map<std::pair<std::string, SymbolSet>, SymbolSet> first_of;
  Element element;
  for (const auto& [stem, last] : last_of) {
    if (stem.empty()) {
      element.push_back({{last}, 0});
    } else {
      first_of[{stem.substr(1), last}] |= set_of(stem.front());
    }
  }
  for (const auto& [key, first] : first_of) {
    Alternative run{{first}, 0};
    for (const char symbol : key.first) run.positions.push_back(set_of(symbol));
    run.positions.push_back(key.second);
    element.push_back(std::move(run));
  }
  for (Alternative& run : element) {
    double count = 1;
    for (const SymbolSet set : run.positions) count *= std::popcount(set);
    run.share = count / static_cast<double>(words.size());
  }
  return element;
}

class Parser {
 public:
  explicit Parser(const std::string& name) : name_(name) {
    country_.code = std::filesystem::path(name).stem().string();
    if (!is_code(country_.code) || country_.code == "any") {
      throw InputError(name,
                       fmt::format("'{}' is not a code for a country: expected up to 16 lower case "
                                   "letters, digits and '-', not 'any'",
                                   printable(country_.code)));
    }
    elements_['D'] = {{{kDigits}, 1}};
    elements_['L'] = {{{kLetters}, 1}};
    elements_['A'] = {{{kDigits | kLetters}, 1}};
  }

  Country parse(std::string_view text) {
    if (text.size() > kMaxFileBytes) {
      throw InputError(name_, fmt::format("{} bytes are more than a country file may have ({})",
                                          text.size(), kMaxFileBytes));
    }
    while (!text.empty()) {
      ++line_;
      const std::size_t end = text.find('\n');
      parse_line(trimmed(text.substr(0, end).substr(0, text.substr(0, end).find('#'))));
      text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    }
    if (country_.layouts.empty()) throw InputError(name_, "has no layout");
    if (country_.name.empty()) country_.name = country_.code;
    for (Layout& layout : country_.layouts) {
      layout.prior = prior_;
      layout.aspect = aspect_;
    }
    return std::move(country_);
  }

 private:
  [[noreturn]] void fail(const std::string& reason) const {
    throw InputError(name_, fmt::format("line {}: {}", line_, reason));
  }

  void parse_line(std::string_view line) {
    if (line.empty()) return;
    if (line.front() < 'a' || line.front() > 'z') return parse_layout(line);
    std::string_view rest = line;
    const std::string_view key = next_word(rest);
    rest = trimmed(rest);
    if (key == "name") {
      country_.name = text_of(rest, "name", 60);
    } else if (key == "cars") {
      prior_ = std::sqrt(parse_weight(next_word(rest)));
      if (!trimmed(rest).empty()) fail("one number is expected: millions of cars");
    } else if (key == "aspect") {
      aspect_ = parse_weight(next_word(rest));
      if (!trimmed(rest).empty()) fail("one number is expected: width by height");
    } else if (key == "group") {
      if (!is_code(rest) || rest == "any") {
        fail(fmt::format("'{}' is not a group: expected lower case letters, digits and '-'",
                         printable(rest)));
      }
      country_.group = rest;
    } else if (key == "set" || key == "words") {
      parse_element(key, rest);
    } else {
      fail(fmt::format("'{}' is none of name, group, cars, aspect, set, words, nor a layout",
                       printable(key)));
    }
  }

  [[nodiscard]] std::string text_of(std::string_view text, std::string_view what,
                                    std::size_t max_size) const {
    if (text.empty() || text.size() > max_size) {
      fail(fmt::format("a {} has 1..{} bytes", what, max_size));
    }
    if (std::any_of(text.begin(), text.end(),
                    [](char c) { return static_cast<unsigned char>(c) < 32 || c == 127; })) {
      fail(fmt::format("the {} holds control characters", what));
    }
    return std::string(text);
  }

  [[nodiscard]] SymbolSet symbols_of(std::string_view text) const {
    SymbolSet set = 0;
    for (const char c : text) {
      if (class_of(c) < 0) {
        fail(
            fmt::format("'{}' is not an upper case letter or digit", printable(std::string(1, c))));
      }
      set |= set_of(c);
    }
    return set;
  }

  void parse_element(std::string_view key, std::string_view rest) {
    const std::string_view letter = next_word(rest);
    if (letter.size() != 1 || letter[0] < 'A' || letter[0] > 'Z') {
      fail(fmt::format("expected '{} X = ...' with one upper case letter X", key));
    }
    if (elements_.contains(letter[0])) {
      fail(fmt::format("'{}' already stands for something", letter));
    }
    if (next_word(rest) != "=") fail(fmt::format("expected '{} {} = ...'", key, letter));
    std::set<std::string> words;
    while (!trimmed(rest).empty()) {
      const std::string_view word = next_word(rest);
      (void)symbols_of(word);
      if (key == "words" && word.size() > 4)
        fail(fmt::format("the word '{}' is longer than 4", word));
      words.emplace(word);
    }
    if (words.empty()) fail(fmt::format("'{} {} =' without symbols", key, letter));
    if (key == "set") {
      // Letters may be written in groups.
      SymbolSet set = 0;
      for (const std::string& word : words) set |= symbols_of(word);
      elements_[letter[0]] = {{{set}, 1}};
    } else {
      elements_[letter[0]] = element_of_words(words);
    }
  }

  // The part of a layout line before "weight" or "name".
  static std::string_view pattern_of(std::string_view line) {
    for (std::size_t at = 0; at + 1 < line.size(); ++at) {
      if (is_blank(line[at]) && line[at + 1] >= 'a' && line[at + 1] <= 'z') {
        return line.substr(0, at);
      }
    }
    return line;
  }

  [[nodiscard]] double parse_weight(std::string_view word) const {
    double weight = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), weight);
    if (error != std::errc() || end != word.data() + word.size() || !(weight >= 1e-6) ||
        !(weight <= 1e6)) {
      fail(fmt::format("weight '{}': expected a number from 0.000001 to 1000000", printable(word)));
    }
    return weight;
  }

  void parse_layout(std::string_view line) {
    const std::string_view pattern = pattern_of(line);
    Layout layout;
    layout.country = country_.code;
    std::string_view rest = line.substr(pattern.size());
    while (!trimmed(rest).empty()) {
      const std::string_view key = next_word(rest);
      if (key == "weight") {
        layout.weight = parse_weight(next_word(rest));
      } else if (key == "name") {
        layout.name = text_of(trimmed(rest), "name", 60);
        rest = {};
      } else {
        fail(
            fmt::format("'{}' after a layout: weight or name is meant to be here", printable(key)));
      }
    }
    expand(trimmed(pattern), layout);
  }

  // Removes the first element of the pattern and returns it.
  [[nodiscard]] Element next_element(std::string_view& pattern) const {
    Element element;
    const char first = pattern.front();
    pattern.remove_prefix(1);
    if (first == '[') {
      const std::size_t end = pattern.find(']');
      if (end == std::string_view::npos || end == 0) fail("'[' without symbols and ']'");
      element = {{{symbols_of(pattern.substr(0, end))}, 1}};
      pattern.remove_prefix(end + 1);
    } else if (first >= '0' && first <= '9') {
      element = {{{set_of(first)}, 1}};
    } else if (const auto found = elements_.find(first); found != elements_.end()) {
      element = found->second;
    } else {
      fail(
          fmt::format("'{}' stands for nothing: D, L, A, a digit, [symbols], or a set or words "
                      "defined above",
                      printable(std::string(1, first))));
    }
    if (!pattern.empty() && pattern.front() == '?') {
      pattern.remove_prefix(1);
      for (Alternative& alternative : element) alternative.share /= 2;
      element.push_back({{}, 0.5});
    }
    return element;
  }

  void expand(std::string_view pattern, const Layout& model) {
    std::vector<Layout> expanded{model};
    const bool marked = pattern.find('|') != std::string_view::npos;
    while (!pattern.empty()) {
      if (is_blank(pattern.front()) || pattern.front() == '|') {
        const bool breaks = marked ? pattern.front() == '|' : true;
        pattern.remove_prefix(1);
        for (Layout& layout : expanded) {
          if (breaks && layout.group_break == 0) {
            layout.group_break = static_cast<int>(layout.positions.size());
          }
        }
        continue;
      }
      const Element element = next_element(pattern);
      std::vector<Layout> next;
      for (const Layout& layout : expanded) {
        for (const Alternative& alternative : element) {
          // Checked here, not after the loop: thousands of words times a thousand layouts take
          // gigabytes.
          if (next.size() + country_.layouts.size() >= kMaxFileLayouts) {
            fail(fmt::format("more than {} layouts", kMaxFileLayouts));
          }
          next.push_back(layout);
          next.back().weight *= alternative.share;
          next.back().positions.insert(next.back().positions.end(), alternative.positions.begin(),
                                       alternative.positions.end());
          if (next.back().positions.size() > kMaxPositions) {
            fail(fmt::format("a layout has {}..{} characters", kMinPositions, kMaxPositions));
          }
        }
      }
      expanded = std::move(next);
    }
    for (Layout& layout : expanded) {
      if (layout.positions.size() < kMinPositions) {
        fail(fmt::format("a layout has {}..{} characters", kMinPositions, kMaxPositions));
      }
      if (layout.group_break == static_cast<int>(layout.positions.size())) layout.group_break = 0;
      country_.layouts.push_back(std::move(layout));
    }
  }

  std::string name_;
  int line_ = 0;
  Country country_;
  double prior_ = 1;
  double aspect_ = 0;
  std::map<char, Element> elements_;
};

// "did you mean 'es'?" if a code is similar, and the list of all known codes.
std::string help_for(const std::string& word, const std::vector<Country>& countries) {
  std::set<std::string> known{"any"};
  std::string best;
  int min_distance = 3;
  const auto consider = [&](const std::string& code, const std::string& spelling) {
    const int distance = edit_distance(lower_case(word), lower_case(spelling));
    const bool near = distance < static_cast<int>(std::max(word.size(), spelling.size()));
    if (near && distance < min_distance) {
      min_distance = distance;
      best = code;
    }
  };
  for (const Country& country : countries) {
    known.insert(country.code);
    consider(country.code, country.name);
    consider(country.code, country.code);
    if (country.group.empty()) continue;
    known.insert(country.group);
    consider(country.group, country.group);
  }
  return fmt::format("{}; known: {}", best.empty() ? "" : ", did you mean '" + best + "'?",
                     fmt::join(known, " "));
}

}  // namespace

Country parse_country(std::string_view text, const std::string& name) {
  return Parser(name).parse(text);
}

std::vector<Country> read_countries(const std::string& folder) {
  namespace fs = std::filesystem;
  std::error_code error;
  std::set<std::string> paths;
  fs::directory_iterator entries(folder, error);
  if (error) throw InputError(folder, error.message());
  for (; entries != fs::directory_iterator(); entries.increment(error)) {
    const fs::path& path = entries->path();
    if (path.extension() == ".txt" && path.filename().string().front() != '.') {
      paths.insert(path.string());
    }
    if (error) throw InputError(folder, error.message());
  }
  if (paths.empty()) throw InputError(folder, "contains no layouts of countries (CODE.txt)");
  std::vector<Country> countries;
  countries.reserve(paths.size());
  for (const std::string& path : paths) {
    countries.push_back(parse_country(read_file(path, kMaxFileBytes), path));
  }
  std::sort(countries.begin(), countries.end(),
            [](const Country& a, const Country& b) { return a.code < b.code; });
  for (const Country& country : countries) {
    const bool clash = std::any_of(countries.begin(), countries.end(), [&](const Country& other) {
      return other.group == country.code;
    });
    if (clash) {
      throw InputError(folder, fmt::format("'{}' is both a country and a group", country.code));
    }
  }
  return countries;
}

CountryChoice choose_countries(const std::vector<Country>& countries,
                               const std::vector<std::string>& requested) {
  CountryChoice choice;
  choice.free_text = requested.empty();
  std::set<std::string> codes;
  for (const std::string& requested_code : requested) {
    const std::string word = lower_case(requested_code);
    bool known = word == "any";
    choice.free_text = choice.free_text || known;
    for (const Country& country : countries) {
      if (country.code == word || (!country.group.empty() && country.group == word)) {
        known = true;
        codes.insert(country.code);
      }
    }
    if (!known) {
      throw UsageError(fmt::format("unknown country '{}'{}", printable(requested_code),
                                   help_for(word, countries)));
    }
  }
  for (const Country& country : countries) {
    if (!choice.free_text && !codes.contains(country.code)) continue;
    choice.layouts.insert(choice.layouts.end(), country.layouts.begin(), country.layouts.end());
  }
  return choice;
}

AspectRange aspect_range(double aspect) {
  if (aspect > 3.7) return AspectRange::kLong;
  if (aspect > 2.7) return AspectRange::kMedium;
  return aspect < 2.3 ? AspectRange::kShort : AspectRange::kMediumShort;
}

CountryChoice weighted_by_aspect(CountryChoice choice, AspectRange range) {
  constexpr double kRareFactor = 0.1;      // American plates on European cars and the like
  constexpr double kFittingFactor = 2.5;   // few plates other than 3:1 ones have this form
  constexpr double kObliqueFactor = 0.04;  // a 4.7:1 plate seen from 55 degrees or more
  constexpr double kExcludedFactor = 0.01;
  for (Layout& layout : choice.layouts) {
    if (layout.aspect <= 0) continue;
    const bool is_short = layout.aspect < 2.4;
    const bool is_long = layout.aspect > 4;
    switch (range) {
      case AspectRange::kLong:
        if (!is_long) layout.prior *= is_short ? kExcludedFactor : kRareFactor;
        break;
      case AspectRange::kMedium:
        if (is_short) layout.prior *= kExcludedFactor;
        if (!is_short && !is_long) layout.prior *= kFittingFactor;
        break;
      case AspectRange::kMediumShort:
        if (is_long) layout.prior *= kObliqueFactor;
        break;
      case AspectRange::kShort:
        if (is_long) layout.prior *= kObliqueFactor;
        break;
    }
  }
  return choice;
}

}  // namespace tarsier::plate
