// SPDX-License-Identifier: MIT
#include "output.h"

#include "tarsier/core/csv.h"
#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>

#include "csv_table.h"
#include "stopwatch.h"
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

namespace tarsier::cli {
namespace {

std::string content(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

TEST(Rounded, KeepsTheGivenNumberOfDigits) {
  EXPECT_EQ(rounded(1.23456, 0), 1);
  EXPECT_EQ(rounded(1.23456, 2), 1.23);
  EXPECT_EQ(rounded(-1.5, 0), -2);
  EXPECT_EQ(nlohmann::json(rounded(0.1 + 0.2, 2)).dump(), "0.3");
  EXPECT_EQ(rounded(0.1234567891234, 9), 0.123456789);
  EXPECT_TRUE(std::isinf(rounded(std::numeric_limits<double>::infinity(), 3)));
  EXPECT_TRUE(std::isnan(rounded(std::nan(""), 3)));
}

TEST(JsonText, ReplacesInvalidUtf8) {
  EXPECT_EQ(json_text({{"b", 1}, {"a", "x"}}), R"({"b":1,"a":"x"})");
  EXPECT_EQ(json_text({{"name", "caf\xe9.png"}}), "{\"name\":\"caf\xef\xbf\xbd.png\"}");
}

TEST(CsvTable, WritesCompleteLinesAtOnce) {
  const TemporaryFolder folder;
  CsvTable table(folder / "table.csv", "frame,name");
  EXPECT_EQ(content(folder / "table.csv"), "frame,name\n");
  table.add("1," + csv_field("a,b"));
  EXPECT_EQ(content(folder / "table.csv"), "frame,name\n1,\"a,b\"\n");
}

TEST(CsvTable, ReportsThePathThatCannotBeWritten) {
  const TemporaryFolder folder;
  try {
    CsvTable(folder / "none/table.csv", "frame");
    FAIL();
  } catch (const OutputError& error) {
    EXPECT_EQ(error.path(), folder / "none/table.csv");
  }
  if (std::ifstream("/dev/full").good()) {
    EXPECT_THROW(CsvTable("/dev/full", "frame"), OutputError);
  }
}

TEST(Stopwatch, TimeDoesNotDecrease) {
  const Stopwatch watch;
  const double first = watch.ms();
  EXPECT_GE(first, 0);
  EXPECT_GE(1000 * watch.seconds(), first);
}

}  // namespace
}  // namespace tarsier::cli
