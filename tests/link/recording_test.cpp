#include "client/link/recording.h"

#include <google/protobuf/util/delimited_message_util.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <optional>
#include <thread>

namespace teletact::client {
namespace {

class RecordingTest : public ::testing::Test {
 protected:
  RecordingTest() : path_("/tmp/teletact-recording-" + std::to_string(::getpid())) {}
  ~RecordingTest() override { std::remove(path_.c_str()); }

  void write(int entries, std::size_t chunk_bytes = 0) {
    v1::RecordHeader header;
    header.set_kind("touch");
    header.set_scene_id("s");
    RecordWriter writer(path_, header);
    for (int n = 0; n < entries; ++n) {
      v1::RecordEntry entry;
      entry.set_monotonic_ns(n);
      if (chunk_bytes > 0) {
        entry.mutable_estimate_request()->mutable_chunk()->set_data(std::string(chunk_bytes, char(n)));
      } else {
        entry.mutable_servo()->set_sequence(static_cast<std::uint32_t>(n));
      }
      writer.append_waiting(std::move(entry));
    }
    writer.close();
    EXPECT_EQ(writer.dropped(), 0u);
  }

  std::string path_;
};

TEST_F(RecordingTest, ComesBackAsItWasWritten) {
  write(5000);
  RecordReader reader(path_);
  EXPECT_EQ(reader.header().kind(), "touch");
  EXPECT_EQ(reader.header().scene_id(), "s");
  int count = 0;
  while (const auto entry = reader.next()) {
    EXPECT_EQ(entry->monotonic_ns(), count);
    EXPECT_EQ(entry->servo().sequence(), static_cast<std::uint32_t>(count));
    ++count;
  }
  EXPECT_EQ(count, 5000);
  EXPECT_FALSE(reader.truncated());
}

TEST_F(RecordingTest, OfAnotherVersionIsRefused) {
  v1::RecordEntry first;
  first.mutable_header()->set_kind("touch");
  for (const std::uint32_t version : {0U, kRecordingVersion + 1}) {
    first.mutable_header()->set_version(version);
    std::ofstream file(path_, std::ios::binary);
    google::protobuf::util::SerializeDelimitedToOstream(first, &file);
    file.close();
    try {
      RecordReader reader(path_);
      FAIL() << version;
    } catch (const std::runtime_error& refused) {
      EXPECT_NE(std::string(refused.what()).find("is of version " + std::to_string(version)),
                std::string::npos)
          << refused.what();
    }
  }
}

TEST_F(RecordingTest, LargeEntriesComeBack) {
  write(90, 1 << 20);
  RecordReader reader(path_);
  int count = 0;
  while (const auto entry = reader.next()) {
    EXPECT_EQ(entry->estimate_request().chunk().data(), std::string(1 << 20, char(count++)));
  }
  EXPECT_EQ(count, 90);
}

TEST_F(RecordingTest, ACutRecordingEndsBeforeTheCut) {
  write(100);
  std::filesystem::resize_file(path_, std::filesystem::file_size(path_) - 3);
  RecordReader reader(path_);
  int count = 0;
  while (reader.next()) ++count;
  EXPECT_EQ(count, 99);
  EXPECT_TRUE(reader.truncated());
}

v1::RecordEntry numbered(int n) {
  v1::RecordEntry entry;
  entry.set_monotonic_ns(n);
  return entry;
}

TEST_F(RecordingTest, IsReadWhileItIsWritten) {
  auto writer = std::make_unique<RecordWriter>(path_, v1::RecordHeader());
  RecordReader reader(path_);
  EXPECT_FALSE(reader.next());
  for (int n = 1; n <= 100; ++n) {
    writer->append(numbered(n));
    std::optional<v1::RecordEntry> entry;
    while (!(entry = reader.next())) std::this_thread::yield();
    EXPECT_EQ(entry->monotonic_ns(), n);
    EXPECT_TRUE(reader.is_written());
  }
  writer->close();
  EXPECT_FALSE(reader.is_written());
  EXPECT_FALSE(reader.next());
  struct stat status {};
  ASSERT_EQ(::stat(path_.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0600u) << "for this user alone";
}

TEST_F(RecordingTest, AnEntryThatIsCutIsReadOnceTheRestIsThere) {
  write(2);
  std::ifstream file(path_, std::ios::binary);
  const std::string whole{std::istreambuf_iterator<char>(file), {}};
  for (std::size_t bytes = whole.size() - 12; bytes < whole.size(); ++bytes) {
    std::ofstream(path_, std::ios::binary) << whole.substr(0, bytes);
    RecordReader reader(path_);
    while (reader.next()) {
    }
    std::ofstream(path_, std::ios::binary | std::ios::app) << whole.substr(bytes);
    std::int64_t last = -1;
    while (const auto entry = reader.next()) last = entry->monotonic_ns();
    EXPECT_EQ(last, 1) << bytes;
    EXPECT_FALSE(reader.truncated());
  }
}

// GIVEN a file of others' eyes WHEN a session records into it THEN it is another, of this user alone.
TEST_F(RecordingTest, AnOpenFileIsReplacedByOneOfThisUserAlone) {
  std::fclose(std::fopen(path_.c_str(), "w"));
  ASSERT_EQ(::chmod(path_.c_str(), 0666), 0);
  write(3);
  struct stat status {};
  ASSERT_EQ(::stat(path_.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0600u);
}

// An entry that says more bytes than there are is not read, however many it says.
TEST_F(RecordingTest, ALengthWithoutItsBytesIsNotYetThere) {
  write(1);
  std::FILE* file = std::fopen(path_.c_str(), "ab");
  std::fputs("\xff\xff\xff\xff\x02", file);  // 0.8 GB
  std::fclose(file);
  RecordReader reader(path_);
  EXPECT_TRUE(reader.next());
  EXPECT_FALSE(reader.next());
  EXPECT_TRUE(reader.truncated());
}

TEST_F(RecordingTest, AnotherWriterIsRefused) {
  auto writer = std::make_unique<RecordWriter>(path_, v1::RecordHeader());
  EXPECT_THROW(RecordWriter(path_, {}), std::runtime_error);
  for (int n = 0; n < 2; ++n) writer->append_waiting(numbered(n));
  writer->close();
  RecordReader earlier(path_);
  RecordWriter later(path_, {});
  EXPECT_FALSE(earlier.is_written());
  EXPECT_TRUE(RecordReader(path_).is_written());
  for (int n = 0; n < 2; ++n) EXPECT_EQ(earlier.next()->monotonic_ns(), n);
  EXPECT_FALSE(earlier.next());
}

TEST_F(RecordingTest, SaysWhatIsWrong) {
  EXPECT_THROW(RecordWriter("/nonexistent/file", {}), std::runtime_error);
  EXPECT_THROW(RecordReader("/nonexistent/file"), std::runtime_error);
  std::FILE* file = std::fopen(path_.c_str(), "w");
  std::fputs("this is no recording", file);
  std::fclose(file);
  EXPECT_THROW(RecordReader reader(path_), std::runtime_error);
}

}  // namespace
}  // namespace teletact::client
