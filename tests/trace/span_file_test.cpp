// The file of lines: bounded, whole lines alone, and what is in the way is said.
#include "service/trace/span_file.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>

#include "tests/files/temporary_folder.h"
#include "tests/trace/short_disk.h"

namespace teletact::service {
namespace {

// So many of it, and the line's end.
std::string line_of(std::size_t count, char of) {
  std::string line(count + 1, of);
  line.back() = '\n';
  return line;
}

namespace fs = std::filesystem;

constexpr std::uint64_t kMost = 1000;

class SpanFiles : public testing::Test {
 protected:
  void expect_refused(const fs::path& path, const std::string& words) const {
    try {
      const SpanFile refused(path, kMost);
      ADD_FAILURE() << path << " was taken";
    } catch (const std::runtime_error& error) {
      const std::string said = error.what();
      EXPECT_NE(said.find("--spans-file " + path.string()), std::string::npos) << said;
      EXPECT_NE(said.find(words), std::string::npos) << said;
    }
  }
  client::TemporaryFolder folder;
  const fs::path path = folder / "spans.jsonl", former = folder / "spans.jsonl.1";
};

TEST_F(SpanFiles, IsItsOwnersAloneAndGoesOnWhereItEnded) {
  for (const char* line : {"one\n", "two\n"}) SpanFile(path, kMost).append(line);
  EXPECT_EQ(client::content_of(path), "one\ntwo\n");
  struct stat found {};
  ASSERT_EQ(stat(path.c_str(), &found), 0);
  EXPECT_EQ(found.st_mode & 0777, 0600U);
}

TEST_F(SpanFiles, HoldsSoManyBytesAndAsManyBefore) {
  SpanFile file(path, kMost);
  const std::string line(99, 'x');
  for (int k = 0; k < 105; ++k) {
    file.append(line + "\n");
    EXPECT_LE(fs::file_size(path), kMost);
  }
  EXPECT_EQ(fs::file_size(path), 500U);
  EXPECT_EQ(fs::file_size(former), kMost);
  EXPECT_EQ(std::distance(fs::directory_iterator(path.parent_path()), fs::directory_iterator()), 2);
  file.append(line_of(5000, 'y'));
  EXPECT_EQ(fs::file_size(path), 5001U) << "a line is not cut";
}

TEST_F(SpanFiles, AHalfLineOfAProcessThatWasKilledEndsThere) {
  std::ofstream(path) << "whole\nhal";
  SpanFile(path, kMost).append("next\n");
  EXPECT_EQ(client::content_of(path), "whole\nhal\nnext\n");
}

TEST_F(SpanFiles, ADiskThatIsFullLeavesNoHalfLine) {
  SpanFile file(path, 1 << 20);
  const std::string long_line = line_of(40, 'x');
  file.append("first\n");
  {
    const ShortDisk disk(30);
    EXPECT_THROW(file.append(long_line), std::runtime_error);
    EXPECT_EQ(client::content_of(path), "first\n");
    EXPECT_THROW(file.append(long_line), std::runtime_error);
    file.append("fits\n");
  }
  file.append(long_line);
  EXPECT_EQ(client::content_of(path), "first\nfits\n" + long_line);
}

TEST_F(SpanFiles, OneThatWasTakenAwayIsMadeAnewWhenItIsFull) {
  SpanFile file(path, kMost);
  file.append(line_of(900, 'x'));
  fs::remove(path);
  file.append(line_of(900, 'y'));
  EXPECT_EQ(fs::file_size(path), 901U);
}

TEST_F(SpanFiles, WhatCannotBeWrittenIsRefused) {
  expect_refused(folder / "absent/spans", "cannot be opened");
  expect_refused(path.parent_path(), "cannot be opened");
  expect_refused("/dev/null", "it is no file");
  const fs::path pipe = folder / "pipe";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  expect_refused(pipe, "it is no file");
  const SpanFile taken(path, kMost);
  expect_refused(path, "another process writes to it");
}

TEST_F(SpanFiles, OneThatCannotBeRenamedKeepsItsBound) {
  SpanFile file(path, kMost);
  file.append(line_of(900, 'x'));
  fs::create_directories(former / "in the way");
  EXPECT_THROW(file.append(line_of(900, 'y')), std::runtime_error);
  EXPECT_EQ(fs::file_size(path), 901U);
  fs::remove_all(former);
  file.append(line_of(900, 'y'));
  EXPECT_EQ(fs::file_size(former), 901U);
}

}  // namespace
}  // namespace teletact::service
