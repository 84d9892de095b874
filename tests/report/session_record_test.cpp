// What is read from recordings, and what of it belongs together.
#include "client/report/session_record.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "client/link/recording.h"
#include "client/servo/states.h"
#include "tests/files/temporary_folder.h"

namespace teletact::client {
namespace {

v1::RecordEntry enabled_tick(bool clutched) {
  v1::RecordEntry entry;
  v1::ServoSample& tick = *entry.mutable_servo();
  for (const double at : {0.05, 0.003}) tick.add_position_m(at);
  for (const double f : {0.0, 0.1}) tick.add_force_n(f);
  tick.set_state(static_cast<std::uint32_t>(ServoState::kEnabled));
  tick.set_clutched(clutched);
  return entry;
}

TEST(SessionRecord, ClutchedTickIsNotEnabled) {
  const TemporaryFolder folder;
  v1::RecordHeader header;
  header.set_kind("touch");
  RecordWriter writer((folder / "touch").string(), header);
  for (const bool clutched : {true, false}) writer.append(enabled_tick(clutched));
  writer.close();
  const TouchRecord record = read_touch_record((folder / "touch").string());
  ASSERT_EQ(record.ticks.size(), 2u);
  EXPECT_FALSE(record.ticks[0].enabled);
  EXPECT_TRUE(record.ticks[1].enabled);
}

TEST(SessionRecord, WindowAfterTheTouchIsNoMismatch) {
  TouchRecord touched;
  touched.ticks.emplace_back().time_s = 10;
  AcquireRecord acquired;
  for (const double published_s : {8.0, 9.0, 13.0}) acquired.windows.emplace_back().published_s = published_s;
  EXPECT_EQ(session_mismatch(touched, acquired), "");
}

// A length of more than 127 bytes takes two: only the first of them is left.
TEST(SessionRecord, CutWithinALengthIsTruncated) {
  const TemporaryFolder folder;
  const std::string path = (folder / "touch").string();
  RecordWriter(path, {}).close();
  const auto header_bytes = std::filesystem::file_size(path);
  RecordWriter writer(path, {});
  v1::RecordEntry entry;
  entry.mutable_log()->set_text(std::string(200, 'a'));
  writer.append(entry);
  writer.close();
  for (const std::uintmax_t kept : {1, 0}) {
    std::filesystem::resize_file(path, header_bytes + kept);
    RecordReader reader(path);
    EXPECT_FALSE(reader.next());
    EXPECT_EQ(reader.truncated(), kept > 0) << kept;
  }
}

}  // namespace
}  // namespace teletact::client
