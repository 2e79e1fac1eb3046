// SPDX-License-Identifier: MIT
// main() of a module's unit tests. --file=NAME runs the tests of the source file NAME.cpp only; the
// flags of GoogleTest work as usual. Exit status 2 where a file has no tests: a misspelt name must
// not pass.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>
#include <string>
#include <string_view>
#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace {

// A filter of GoogleTest with every test that `stem`.cpp defines; empty where there is none.
std::string filter_of(std::string_view stem) {
  std::string filter;
  const testing::UnitTest& all = *testing::UnitTest::GetInstance();
  for (int i = 0; i < all.total_test_suite_count(); ++i) {
    const testing::TestSuite& suite = *all.GetTestSuite(i);
    for (int k = 0; k < suite.total_test_count(); ++k) {
      const testing::TestInfo& test = *suite.GetTestInfo(k);
      if (std::filesystem::path(test.file()).stem() == stem)
        filter += std::string(suite.name()) + "." + test.name() + ":";
    }
  }
  return filter;
}

}  // namespace

int main(int argc, char** argv) {
#ifdef __GLIBC__  // as the program does (framework/cli.cpp): images that come and go keep their pages
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
  mallopt(M_TRIM_THRESHOLD, 128 << 20);
#endif
  testing::InitGoogleMock(&argc, argv);
  constexpr std::string_view kFile = "--file=";
  for (int i = 1; i < argc; ++i) {
    const std::string_view word = argv[i];
    if (!word.starts_with(kFile)) continue;
    const std::string filter = filter_of(word.substr(kFile.size()));
    if (filter.empty()) {
      std::fprintf(stderr, "no tests in %s.cpp\n", argv[i] + kFile.size());
      return 2;
    }
    testing::GTEST_FLAG(filter) = filter;
  }
  return RUN_ALL_TESTS();
}
