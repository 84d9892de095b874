// A device whose kernels are compiled from a copy of the sources that a test has sabotaged.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "service/device/device.h"
#include "tests/support/environment.h"

namespace teletact::service {

class FaultyKernels : public testing::Test {
 protected:
  void SetUp() override {
    std::string folder = (std::filesystem::temp_directory_path() / "teletact-faults-XXXXXX").string();
    ASSERT_NE(mkdtemp(folder.data()), nullptr);
    folder_ = folder;
    std::filesystem::copy(teletact::test::source_kernels(), folder_,
                          std::filesystem::copy_options::recursive);
    options_.kernel_directory = folder_.string();
    options_.cache_directory = "none";
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  // Replaces `from` in a kernel file.
  void sabotage(const std::string& file, const std::string& from, const std::string& to) {
    std::stringstream text;
    text << std::ifstream(folder_ / file).rdbuf();
    std::string source = text.str();
    const auto at = source.find(from);
    ASSERT_NE(at, std::string::npos) << file << " has no " << from;
    std::ofstream(folder_ / file) << source.replace(at, from.size(), to);
  }
  std::filesystem::path folder_;
  DeviceOptions options_;
};

}  // namespace teletact::service
