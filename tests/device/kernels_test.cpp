// Every kernel file of the product is a program of its own.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>

#include "service/device/device.h"
#include "service/device/program.h"
#include "tests/support/environment.h"

namespace teletact::service {
namespace {

namespace fs = std::filesystem;

std::string first_kernel(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  const std::string source = text.str();
  std::smatch match;
  return std::regex_search(source, match, std::regex("kernel\\s[^;{]*?void\\s+(\\w+)\\s*\\("))
             ? match[1].str()
             : "";
}

TEST(Kernels, EachFileBuildsWithRealAloneInEveryPrecision) {
  const auto device = Device::open(
      {.kernel_directory = teletact::test::source_kernels().string(), .cache_directory = "none"});
  const Queue queue = device->queue();
  std::size_t built = 0;
  for (const auto& entry : fs::directory_iterator(teletact::test::source_kernels())) {
    if (entry.path().extension() != ".cl") continue;
    const std::string kernel = first_kernel(entry.path());
    ASSERT_NE(kernel, "") << entry.path() << " holds no kernel";
    for (const Precision precision : {Precision::kFloat, Precision::kDouble}) {
      if (!queue.supports(precision)) continue;
      EXPECT_NO_THROW(queue.kernel(entry.path().stem().string(), kernel, precision)) << entry.path();
      ++built;
    }
  }
  EXPECT_GE(built, 4u);
}

TEST(Kernels, EmbeddedSourcesAreThoseOnDisk) {
  for (const auto& entry : fs::directory_iterator(teletact::test::source_kernels())) {
    if (entry.path().extension() != ".cl") continue;
    const std::string name = entry.path().stem().string();
    EXPECT_EQ(program_source(name, ""), program_source(name, teletact::test::source_kernels().string()));
  }
}

}  // namespace
}  // namespace teletact::service
