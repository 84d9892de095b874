#include "client/files/different_files.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "tests/files/temporary_folder.h"

namespace teletact::client {
namespace {

namespace fs = std::filesystem;

std::string refusal(const std::vector<NamedFile>& files) {
  try {
    require_different_files(files);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(DifferentFiles, OneFileByTwoNamesIsRefusedWithBothPurposes) {
  const TemporaryFolder folder;
  const fs::path file = folder / "a", link = folder / "b";
  std::ofstream(file) << 'x';
  fs::create_symlink(file, link);
  for (const fs::path& other : {file, link, folder / "." / "a"}) {
    const std::string said = refusal({{"--from", file}, {"--other", ""}, {"--record", other}});
    EXPECT_NE(said.find("--record"), std::string::npos) << other;
    EXPECT_NE(said.find("--from"), std::string::npos) << other;
  }
  // also where neither is there yet
  EXPECT_NE(refusal({{"--a", folder / "new"}, {"--b", folder / "x" / ".." / "new"}}), "");
}

TEST(DifferentFiles, DifferentOrUnnamedFilesPass) {
  const TemporaryFolder folder;
  EXPECT_EQ(refusal({{"--a", folder / "a"}, {"--b", folder / "b"}}), "");
  EXPECT_EQ(refusal({{"--a", ""}, {"--b", ""}}), "");
}

}  // namespace
}  // namespace teletact::client
