// Recordings: what reads them, what a report makes of them, and what is written again.
#include "client/link/recording.h"

#include <google/protobuf/util/message_differencer.h>

#include <cmath>
#include <vector>

#include "client/report/session_record.h"
#include "tests/fuzzers/client/fuzzers.h"

namespace teletact::fuzzers {
namespace {

struct Contents {
  v1::RecordHeader header;
  std::vector<std::string> entries;  // each as its message's bytes
};

Contents contents_of(const std::string& path) {
  client::RecordReader reader(path);
  Contents contents{reader.header(), {}};
  while (const auto entry = reader.next()) contents.entries.push_back(entry->SerializeAsString());
  return contents;
}

void write(const std::string& path, const Contents& contents) {
  client::RecordWriter writer(path, contents.header);
  for (const std::string& bytes : contents.entries) {
    v1::RecordEntry entry;
    require(entry.ParseFromString(bytes), "an entry that was read cannot be parsed again");
    writer.append_waiting(std::move(entry));
  }
  writer.close();
}

void check_rewritten(const Contents& contents) {
  static const Folder folder;
  const std::string path = folder.path() / "again.rec";
  write(path, contents);
  const Contents again = contents_of(path);
  require(again.entries == contents.entries, "it is read back as another");
  require(again.header.SerializeAsString() == contents.header.SerializeAsString(),
          "its header is read back as another");
}

void check(const client::TouchRecord& touch, const client::AcquireRecord* acquire) {
  require(!touch.ticks.empty(), "a touch without a tick");
  for (const client::TactileFrame& frame : touch.tactile)
    require(frame.image.pressure_pa.size() == frame.image.along_x * frame.image.along_z,
            "taxels that do not fill an image");
  client::stated_interval(touch, touch.ticks.front());
  if (acquire) accepted<std::runtime_error>([&] { client::session_mismatch(touch, *acquire); });
}

}  // namespace

bool recording(Bytes bytes) {
  static InputFile file;
  file.fill(bytes);
  Contents contents;
  if (accepted<std::runtime_error>([&] { contents = contents_of(file.path()); })) {
    require(contents.entries.size() < bytes.size(), "more entries than bytes");
    check_rewritten(contents);
  }
  client::TouchRecord touch;
  client::AcquireRecord acquire;
  const bool acquired =
      accepted<std::runtime_error>([&] { acquire = client::read_acquire_record(file.path()); });
  if (accepted<std::runtime_error>([&] { touch = client::read_touch_record(file.path()); }))
    check(touch, acquired ? &acquire : nullptr);
  if (!acquired) return !touch.ticks.empty();
  // What was acquired of a touch that knows nothing against it.
  client::TouchRecord other;
  other.scene_id = acquire.scene_id;
  other.ticks.emplace_back();
  accepted<std::runtime_error>([&] { client::session_mismatch(other, acquire); });
  return true;
}

}  // namespace teletact::fuzzers
