// The main() of every test binary: GoogleTest's, less the cases that belong to a group of their own.
#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  std::string filter = GTEST_FLAG_GET(filter);
  if (const char* later = std::getenv("TELETACT_LATER"); later != nullptr && *later != 0)
    GTEST_FLAG_SET(filter, filter + (filter.find('-') == std::string::npos ? "-" : ":") + later);
  return RUN_ALL_TESTS();
}
