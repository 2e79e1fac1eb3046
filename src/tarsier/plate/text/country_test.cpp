// SPDX-License-Identifier: MIT
#include "tarsier/plate/text/country.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/plate/text/reading.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>
#include <string>

namespace tarsier::plate {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

bool fits(const Layout& layout, const std::string& text) {
  if (text.size() != layout.positions.size()) return false;
  for (std::size_t k = 0; k < text.size(); ++k) {
    const auto shift = static_cast<unsigned>(class_of(text[k]));
    if ((layout.positions[k] >> shift & 1U) == 0) return false;
  }
  return true;
}

int layouts_of(const Country& country, const std::string& text) {
  int count = 0;
  for (const Layout& layout : country.layouts) count += fits(layout, text) ? 1 : 0;
  return count;
}

std::string error_of(const std::string& text, const std::string& name = "xx.txt") {
  try {
    (void)parse_country(text, name);
  } catch (const InputError& error) {
    EXPECT_EQ(error.path(), name);
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    return error.what();
  }
  return "accepted";
}

TEST(CountryTest, LayoutAllowsOnlyItsSymbols) {
  const Country country = parse_country(
      "# Spain\r\nname Spain\ngroup eu\n"
      "set C = BCDFGHJKLMNPRSTVWXYZ\n"
      "DDDD CCC  weight 10  name now  # since 2000\n",
      "a/folder/es.txt");
  EXPECT_EQ(country.code, "es");
  EXPECT_EQ(country.name, "Spain");
  EXPECT_EQ(country.group, "eu");
  ASSERT_EQ(country.layouts.size(), 1U);
  const Layout& layout = country.layouts[0];
  EXPECT_EQ(layout.country, "es");
  EXPECT_EQ(layout.name, "now");
  EXPECT_EQ(layout.weight, 10);
  EXPECT_EQ(layout.group_break, 4);
  EXPECT_TRUE(fits(layout, "1234BCD"));
  EXPECT_FALSE(fits(layout, "1234BCA"));
  EXPECT_FALSE(fits(layout, "123OBCD"));
  EXPECT_FALSE(fits(layout, "1234BC"));
}

TEST(CountryTest, WordsExpandExactlyAndShareTheWeight) {
  const std::set<std::string> words{"M", "B", "SE", "SA", "GE", "GA", "GI", "ABC", "ABD"};
  std::string line = "words P =";
  for (const std::string& word : words) line += " " + word;
  const Country country = parse_country(line + "\nP DD weight 9\n", "es.txt");
  double weight = 0;
  for (const Layout& layout : country.layouts) {
    weight += layout.weight;
    EXPECT_EQ(layout.group_break, static_cast<int>(layout.positions.size()) - 2);
  }
  EXPECT_NEAR(weight, 9, 1e-12);
  EXPECT_LT(country.layouts.size(), words.size());
  // All texts of one to three letters, compared with the list.
  std::vector<std::string> texts{""};
  for (std::size_t k = 0; k < texts.size(); ++k) {
    const std::string word = texts[k];
    EXPECT_EQ(layouts_of(country, word + "12"), words.contains(word) ? 1 : 0) << word;
    for (char c = 'A'; word.size() < 3 && c <= 'Z'; ++c) texts.push_back(word + c);
  }
}

TEST(CountryTest, ParsesOptionalPositionsLiteralsAndRowBreaks) {
  const Country country = parse_country("[B] DDD? LLL\n1 A|[XYZ]D weight 0.5\n", "ro.txt");
  EXPECT_EQ(layouts_of(country, "B12ABC"), 1);
  EXPECT_EQ(layouts_of(country, "B123ABC"), 1);
  EXPECT_EQ(layouts_of(country, "A123ABC"), 0);
  EXPECT_EQ(layouts_of(country, "1QY7"), 1);
  EXPECT_EQ(layouts_of(country, "1QW7"), 0);
  EXPECT_EQ(country.layouts[0].weight, 0.5);
  EXPECT_EQ(country.layouts[0].group_break, 1);
  EXPECT_EQ(country.layouts.back().group_break, 2);
}

TEST(CountryTest, ErrorNamesTheLine) {
  EXPECT_THAT(error_of("DDD\nnonsense here\n"), HasSubstr("line 2: 'nonsense'"));
  EXPECT_THAT(error_of("\n\nDDX\n"), HasSubstr("line 3: 'X' stands for nothing"));
  EXPECT_THAT(error_of("D\n"), HasSubstr("2..12"));
  EXPECT_THAT(error_of("DDDDDDDDDDDDD\n"), HasSubstr("2..12"));
  EXPECT_THAT(error_of("DD?\nD?D?D?\n"), HasSubstr("line 1"));
  EXPECT_THAT(error_of("DDD weight -1\n"), HasSubstr("weight '-1'"));
  EXPECT_THAT(error_of("DDD weight nan\n"), HasSubstr("weight 'nan'"));
  EXPECT_THAT(error_of("DDD weight\n"), HasSubstr("weight ''"));
  EXPECT_THAT(error_of("DDD wieght 2\n"), HasSubstr("'wieght'"));
  EXPECT_THAT(error_of("set C BCD\nCC\n"), HasSubstr("expected 'set C = ...'"));
  EXPECT_THAT(error_of("set D = 1\nDD\n"), HasSubstr("already"));
  EXPECT_THAT(error_of("set C =\nCC\n"), HasSubstr("without symbols"));
  EXPECT_THAT(error_of("set C = b\nCC\n"), HasSubstr("'b'"));
  EXPECT_THAT(error_of("DD[AB\n"), HasSubstr("']'"));
  EXPECT_THAT(error_of("DD[]D\n"), HasSubstr("']'"));
  EXPECT_THAT(error_of("name\x01 x\nDD\n"), HasSubstr("\\x01"));
  EXPECT_THAT(error_of("name Spain\n"), HasSubstr("no layout"));
  EXPECT_THAT(error_of(""), HasSubstr("no layout"));
  EXPECT_THAT(error_of("group EU\nDD\n"), HasSubstr("'EU'"));
  EXPECT_THAT(error_of("DD\n", "any.txt"), HasSubstr("'any'"));
  EXPECT_THAT(error_of("DD\n", "Spain Old.txt"), HasSubstr("Spain Old"));
  EXPECT_THAT(error_of(std::string(200'000, '#')), HasSubstr("200000 bytes"));
  EXPECT_THAT(error_of("A?A?A?A?A?A?A?A?A?A?A?A?\n"), HasSubstr("line 1: more than"));
  EXPECT_NE(error_of(std::string("\0\xFF\x80[[??||", 8)), "accepted");
}

// Nine hundred layouts times thousands of words would take gigabytes. So they are counted before
// they are expanded.
TEST(CountryTest, LimitsTheNumberOfLayouts) {
  constexpr std::string_view kSymbols = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789";
  const auto words = [&](std::size_t count) {  // no two of them can be merged into one run
    std::string text;
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t inner = i % 1296;
      text +=
          {' ', kSymbols[i / 1296], kSymbols[inner / 36], kSymbols[inner % 36], kSymbols[i / 1296]};
    }
    return text;
  };
  EXPECT_THAT(error_of("words P =" + words(900) + "\nwords Q =" + words(15'000) + "\nP Q\n"),
              HasSubstr("line 3: more than 1000 layouts"));
}

// Existing plates, and some texts that are no valid plate.
TEST(CountryTest, ShippedFilesMatchExistingPlates) {
  const std::vector<Country> countries = read_countries(TARSIER_SOURCE_MODELS "/countries");
  const auto known = [&](const std::string& code, const std::string& text) {
    for (const Country& country : countries) {
      if (country.code == code) return layouts_of(country, text) > 0;
    }
    ADD_FAILURE() << "no country " << code;
    return false;
  };
  for (const auto& [code, texts] : std::vector<std::pair<std::string, std::vector<std::string>>>{
           {"es", {"1234BCD", "M1234AB", "SE1234B", "B123456", "C1234BCD", "PGC12345B"}},
           {"sk", {"BA123AB", "PP587AO", "AA001AB"}},
           {"cz", {"1A12345", "5AC1234", "ABC1234"}},
           {"de", {"BMW123", "MAB1234", "HROA12", "ABCDE12", "MX100E"}},
           {"at", {"W12345A", "GU123AB"}},
           {"it", {"AB123CD"}},
           {"fr", {"AA123BB", "1234AB75"}},
           {"pl", {"WA12345", "KR1AC23", "WPI1234", "DWR12AC"}},
           {"ro", {"B123ABC", "B12ABC", "CJ12ABC"}},
           {"hu", {"ABC123", "AABC123"}},
           {"bg", {"CB1234AB", "B1234AB"}},
           {"gr", {"YKA1234"}},
           {"pt", {"12AB34", "AB12CD"}},
           {"nl", {"12BDF3", "BD123F"}},
           {"be", {"1ABC123"}},
           {"uk", {"AB12CDE", "A123BCD"}},
           {"ie", {"131D12345", "08D1234", "99MH123"}},
           {"ch", {"ZH123456", "GE1234"}},
           {"se", {"ABC123", "ABC12D"}},
           {"us", {"7ABC123", "ABC1234", "R820503"}},
           {"br", {"ABC1234", "ABC1D23"}}}) {
    for (const std::string& text : texts) EXPECT_TRUE(known(code, text)) << code << " " << text;
  }
  for (const auto& [code, text] :
       std::vector<std::pair<std::string, std::string>>{{"es", "1234ABC"},
                                                        {"es", "XX1234AB"},
                                                        {"it", "AI123CD"},
                                                        {"fr", "AO123BB"},
                                                        {"ro", "CJ12OBC"},
                                                        {"de", "BMW0123"},
                                                        {"gr", "DKA1234"},
                                                        {"bg", "CB1234DB"},
                                                        {"nl", "12AEI3"},
                                                        {"sk", "BA123QB"},
                                                        {"br", "AB12345"},
                                                        {"uk", "QI12CDE"}}) {
    EXPECT_FALSE(known(code, text)) << code << " " << text;
  }
  // All of them together are within the decoder's limit.
  EXPECT_LT(choose_countries(countries, {}).layouts.size(), 1000U);
}

class CountryFolder : public FolderTest {};

TEST_F(CountryFolder, CountriesAreChosenByCodeOrGroup) {
  write_file_atomically(path("sk.txt"), "group eu\nLLDDDLL\n");
  write_file_atomically(path("es.txt"), "name Spain\ngroup eu\nDDDDLLL\n");
  write_file_atomically(path("us.txt"), "name United States\nLLLDDDD\nLLLDDD\n");
  write_file_atomically(path("notes.md"), "not a country");
  write_file_atomically(path(".hidden.txt"), "not a country");
  const std::vector<Country> countries = read_countries(folder_);
  std::vector<std::string> codes;
  for (const Country& country : countries) codes.push_back(country.code);
  EXPECT_THAT(codes, ElementsAre("es", "sk", "us"));

  EXPECT_EQ(choose_countries(countries, {"es"}).layouts.size(), 1U);
  EXPECT_FALSE(choose_countries(countries, {"es"}).free_text);
  EXPECT_EQ(choose_countries(countries, {"eu"}).layouts.size(), 2U);
  EXPECT_EQ(choose_countries(countries, {"ES", "eu", "us"}).layouts.size(), 4U);
  for (const auto& all : {std::vector<std::string>{}, {"any"}, {"es", "any"}}) {
    EXPECT_EQ(choose_countries(countries, all).layouts.size(), 4U);
    EXPECT_TRUE(choose_countries(countries, all).free_text);
  }
}

TEST_F(CountryFolder, ErrorSuggestsTheNearestCode) {
  write_file_atomically(path("es.txt"), "name Spain\ngroup eu\nDDDDLLL\n");
  write_file_atomically(path("br.txt"), "name Brazil\nLLLDDDD\n");
  const std::vector<Country> countries = read_countries(folder_);
  const auto error_of_choice = [&](const std::string& word) -> std::string {
    try {
      (void)choose_countries(countries, {word});
    } catch (const UsageError& error) {
      return error.what();
    }
    return "accepted";
  };
  EXPECT_THAT(error_of_choice("brr"), HasSubstr("'br'"));
  EXPECT_THAT(error_of_choice("spain"), HasSubstr("did you mean 'es'?"));
  EXPECT_THAT(error_of_choice("zzzz"), HasSubstr("known: any br es eu"));
  EXPECT_THAT(error_of_choice(""), HasSubstr("unknown country ''"));
  EXPECT_THAT(error_of_choice("\x1b[2J"), Not(HasSubstr("\x1b")));
}

TEST_F(CountryFolder, ErrorNamesTheFile) {
  EXPECT_THROW((void)read_countries(folder_), InputError) << "no files";
  write_file_atomically(path("es.txt"), "DDDDLLL\nDDDD?!\n");
  try {
    (void)read_countries(folder_);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("es.txt: line 2"));
  }
  EXPECT_THROW((void)read_countries(path("missing")), InputError);
  write_file_atomically(path("es.txt"), "group br\nDDDDLLL\n");
  write_file_atomically(path("br.txt"), "LLLDDDD\n");
  EXPECT_THROW((void)read_countries(folder_), InputError);
}

TEST(AspectRangeTest, PriorsFollowTheAspectRatio) {
  CountryChoice choice;
  for (const char* text : {"aspect 2\ncars 100\nLLLDDD\n", "aspect 4.7\nLLLDDD\n", "LLLDDD\n",
                           "aspect 3.1\nLLLDDD\n"}) {
    const Country country = parse_country(text, "xx.txt");
    choice.layouts.push_back(country.layouts.at(0));
  }
  EXPECT_EQ(aspect_range(4.5), AspectRange::kLong);
  EXPECT_EQ(aspect_range(3.1), AspectRange::kMedium);
  EXPECT_EQ(aspect_range(2.5), AspectRange::kMediumShort);
  EXPECT_EQ(aspect_range(1.9), AspectRange::kShort);
  const auto priors = [&](AspectRange form) {
    std::vector<double> result;
    for (const Layout& layout : weighted_by_aspect(choice, form).layouts)
      result.push_back(layout.prior);
    return result;
  };
  const std::vector<double> priors_medium_short = priors(AspectRange::kMediumShort);
  EXPECT_EQ(priors_medium_short[0], 10);
  EXPECT_LT(priors_medium_short[1], priors_medium_short[2]);
  EXPECT_EQ(priors_medium_short[3], 1);
  const std::vector<double> priors_long = priors(AspectRange::kLong);
  EXPECT_LT(priors_long[0], priors_long[1]);
  EXPECT_LT(priors_long[3], priors_long[1]);
  EXPECT_EQ(priors_long[2], 1);
  const std::vector<double> priors_medium = priors(AspectRange::kMedium);
  EXPECT_LT(priors_medium[0], priors_medium[1]);
  EXPECT_LT(priors_medium[1], priors_medium[3]);
  EXPECT_EQ(priors_medium[1], 1);
  EXPECT_EQ(priors_medium[2], 1);
  const std::vector<double> priors_short = priors(AspectRange::kShort);
  EXPECT_LT(priors_short[1], priors_short[2]);
  EXPECT_EQ(priors_short[0], 10);
  EXPECT_THROW((void)parse_country("aspect wide\nLLL\n", "xx.txt"), InputError);
}

}  // namespace
}  // namespace tarsier::plate
