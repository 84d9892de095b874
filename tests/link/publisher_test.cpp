#include "client/link/publisher.h"

#include <google/protobuf/io/zero_copy_stream_impl.h>
#include <google/protobuf/util/delimited_message_util.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

namespace teletact::client {
namespace {

std::string socket_path(const char* name) {
  return "/tmp/teletact-publish-" + std::string(name) + "-" + std::to_string(::getpid());
}

v1::RecordHeader header() {
  v1::RecordHeader out;
  out.set_kind("touch");
  out.set_scene_id("s");
  return out;
}

v1::RecordEntry tick(std::int64_t time_ns) {
  v1::RecordEntry entry;
  entry.set_monotonic_ns(time_ns);
  entry.mutable_servo()->set_state(1);
  return entry;
}

class Watcher {
 public:
  explicit Watcher(const std::string& path) : file_(connect_to(path)), stream_(file_.get()) {}
  bool connected() const { return static_cast<bool>(file_); }
  bool next(v1::RecordEntry& entry) {
    entry.Clear();
    bool clean_end = false;
    return google::protobuf::util::ParseDelimitedFromZeroCopyStream(&entry, &stream_, &clean_end);
  }

 private:
  FileDescriptor file_;
  google::protobuf::io::FileInputStream stream_;
};

TEST(Publisher, NewcomerGetsTheHeaderBeforeNews) {
  Publisher publisher(socket_path("new"), header());
  v1::RecordEntry open;
  open.mutable_touch_request()->mutable_open()->set_session_id("me");
  publisher.append(open);
  v1::RecordEntry opened;
  opened.mutable_touch_response()->mutable_opened()->set_period_s(0.002);
  publisher.append(opened);
  publisher.append(tick(1));  // before anybody looks
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  Watcher watcher(socket_path("new"));
  v1::RecordEntry entry;
  ASSERT_TRUE(watcher.next(entry));
  EXPECT_EQ(entry.header().scene_id(), "s");
  EXPECT_EQ(entry.header().version(), kRecordingVersion);
  ASSERT_TRUE(watcher.next(entry));
  EXPECT_EQ(entry.touch_request().open().session_id(), "me");
  ASSERT_TRUE(watcher.next(entry));
  EXPECT_EQ(entry.touch_response().opened().period_s(), 0.002);
  publisher.append(tick(2));
  ASSERT_TRUE(watcher.next(entry));
  EXPECT_EQ(entry.monotonic_ns(), 2);
}

// As when the tip is changed in the middle of a session.
TEST(Publisher, ANewcomerGetsTheHeaderAndTheNewestStreamAlone) {
  Publisher publisher(socket_path("again"), header());
  v1::RecordEntry open, opened;
  opened.mutable_touch_response()->mutable_opened()->set_period_s(0.002);
  for (const char* session : {"first", "second"}) {
    open.mutable_touch_request()->mutable_open()->set_session_id(session);
    publisher.append(open);
    publisher.append(opened);
  }
  Watcher watcher(socket_path("again"));
  v1::RecordEntry entry;
  ASSERT_TRUE(watcher.next(entry));
  EXPECT_TRUE(entry.has_header());
  ASSERT_TRUE(watcher.next(entry));
  EXPECT_EQ(entry.touch_request().open().session_id(), "second");
  ASSERT_TRUE(watcher.next(entry));
  EXPECT_TRUE(entry.touch_response().has_opened());
}

TEST(Publisher, LeavesOutLawsFramesAndMaps) {
  Publisher publisher(socket_path("laws"), header());
  Watcher watcher(socket_path("laws"));
  v1::RecordEntry entry;
  ASSERT_TRUE(watcher.next(entry));
  v1::RecordEntry law, chunk, map;
  law.mutable_touch_response()->mutable_law();
  chunk.mutable_estimate_request()->mutable_chunk();
  map.mutable_estimate_response()->mutable_map();
  for (const v1::RecordEntry& heavy : {law, chunk, map}) publisher.append(heavy);
  publisher.append(tick(3));
  ASSERT_TRUE(watcher.next(entry));
  EXPECT_EQ(entry.monotonic_ns(), 3);
}

// Whoever appends does not wait for a peer that reads nothing, and another peer gets all.
TEST(Publisher, APeerThatStallsLosesWhatItHasNoRoomForAlone) {
  Publisher publisher(socket_path("stall"), header());
  Watcher stalls(socket_path("stall")), reads(socket_path("stall"));
  v1::RecordEntry entry;
  ASSERT_TRUE(reads.next(entry));
  v1::RecordEntry large = tick(0);
  large.mutable_log()->set_text(std::string(1 << 20, 'x'));
  const int entries = 12;
  for (int n = 1; n <= entries; ++n) {
    large.set_monotonic_ns(n);
    publisher.append(large);
    ASSERT_TRUE(reads.next(entry));
    EXPECT_EQ(entry.monotonic_ns(), n);
  }
  EXPECT_GT(publisher.dropped(), 0u);
  EXPECT_LE(publisher.dropped(), static_cast<std::uint64_t>(entries));
}

TEST(Publisher, SendsWhatIsLeftWhenItEnds) {
  auto publisher = std::make_unique<Publisher>(socket_path("end"), header());
  Watcher watcher(socket_path("end"));
  v1::RecordEntry entry;
  ASSERT_TRUE(watcher.next(entry));
  for (int n = 1; n <= 100; ++n) publisher->append(tick(n));
  publisher.reset();
  int last = 0;
  while (watcher.next(entry)) last = static_cast<int>(entry.monotonic_ns());
  EXPECT_EQ(last, 100);
  EXPECT_FALSE(std::filesystem::exists(socket_path("end")));
}

TEST(Publisher, IsForThisUserAloneAndForSoManyAtOnce) {
  Publisher publisher(socket_path("many"), header());
  struct stat status {};
  ASSERT_EQ(::stat(socket_path("many").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0600u);
  std::vector<std::unique_ptr<Watcher>> watchers;
  v1::RecordEntry entry;
  for (std::size_t n = 0; n < Publisher::kMaxPeers; ++n) {
    watchers.push_back(std::make_unique<Watcher>(socket_path("many")));
    ASSERT_TRUE(watchers.back()->next(entry)) << n;
  }
  Watcher late(socket_path("many"));
  EXPECT_FALSE(late.next(entry)) << "one too many";
  watchers.front().reset();
  for (int n = 0; n < 100; ++n) {
    Watcher next(socket_path("many"));
    if (next.next(entry)) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  FAIL() << "a place that was given up is not given again";
}

TEST(Publisher, RefusesAPathThatIsInUseAndTakesOverALeftOne) {
  const std::string path = socket_path("path");
  std::ofstream(path) << "a file\n";
  EXPECT_THROW(Publisher(path, header()), std::runtime_error);
  std::filesystem::remove(path);
  EXPECT_THROW(Publisher(std::string(200, 'x'), header()), std::runtime_error);
  EXPECT_THROW(Publisher("", header()), std::runtime_error);
  try {
    Publisher nowhere("/nodir/touch", header());
    ADD_FAILURE();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("choose an existing folder"), std::string::npos) << error.what();
  }
  {
    Publisher first(path, header());
    EXPECT_THROW(Publisher(path, header()), std::runtime_error);
  }
  { const FileDescriptor left = listen_at("--publish", path); }  // killed: the socket stays
  Publisher again(path, header());
  EXPECT_TRUE(Watcher(path).connected());
}

}  // namespace
}  // namespace teletact::client
