// Sessions as they are recorded, and as the view takes them.
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>
#include <thread>

#include "client/link/recording.h"
#include "client/watch/sources.h"
#include "tests/files/temporary_folder.h"
#include "tests/watch/web_peer.h"

namespace teletact::client {
namespace {

// The page's status once a session that is recorded is taken into a view that has shown something.
nlohmann::json status_after(bool first) {
  const TemporaryFolder folder;
  View view;
  v1::RecordEntry line;
  line.mutable_log()->set_text("servo ENABLED");
  view.take(line);
  v1::RecordHeader header;
  header.set_kind("acquire");
  { const RecordWriter earlier(folder / "session", header); }
  const RecordWriter writer(folder / "session", header);
  const SessionSource source(folder / "session", "source", first, view);
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  nlohmann::json status = nlohmann::json::object();
  while (status.value("source", "") != "live" && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    View::Seen seen;
    status =
        test::decoded(frame(1, view.news(seen))).slots.at(static_cast<std::uint32_t>(Channel::kStatus)).json;
  }
  EXPECT_EQ(status["source"], "live");
  return status;
}

TEST(SessionSource, TheFirstAloneBeginsTheViewAnew) {
  EXPECT_EQ(status_after(true)["log"].size(), 0u);
  EXPECT_EQ(status_after(false)["log"].size(), 1u) << "the patient's side takes nothing away";
}

}  // namespace
}  // namespace teletact::client
