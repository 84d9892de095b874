// Certificates that change while the service serves.
#include <sys/stat.h>

#include <fstream>
#include <iterator>
#include <thread>

#include "service/rpc/tls.h"
#include "tests/rpc/guarded_server.h"
#include "tests/support/finger_reader.h"

namespace teletact::service {
namespace {

using grpc::StatusCode;

const std::string kEntries = entry_of("root", "administrator");

StatusCode asked(const Shown& who) {
  grpc::ClientContext context;
  who.on(context);
  v1::GetInfoResponse response;
  return v1::Info::NewStub(who.channel)->GetInfo(&context, {}, &response).error_code();
}

// Whether new connections come to be served so: files are looked at by gRPC's own clock.
template <class Channel>
bool comes(Channel&& channel, StatusCode code, const std::string& token = "") {
  const auto give_up = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  while (asked({channel(), token}) != code) {
    if (std::chrono::steady_clock::now() > give_up) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  return true;
}

// A watcher of the finger, which goes on for as long as its connection is there.
class Watching {
 public:
  explicit Watching(const Shown& who) : stub_(v1::Palpation::NewStub(who.channel)) {
    v1::Scene scene;
    grpc::ClientContext context;
    who.on(context);
    EXPECT_TRUE(stub_->CreateScene(&context, uniform_scene("s"), &scene).ok());
    who.on(context_);
    reader_ = std::make_unique<FingerReader>(*stub_, context_, "s");
  }
  ~Watching() { context_.TryCancel(); }
  bool goes_on() {
    v1::FingerState state;
    return reader_->read(&state);
  }

 private:
  std::unique_ptr<v1::Palpation::Stub> stub_;
  grpc::ClientContext context_;
  std::unique_ptr<FingerReader> reader_;
};

TEST(NewCertificate, IsShownToWhoComesAndRunningCallsGoOn) {
  GuardedServer server(Transport::kTls, kEntries);
  Watching watching({server.channel(), "root-token"});
  ASSERT_TRUE(watching.goes_on());
  const Identity other = make_authority("other");
  const auto by_other = [&] { return server.channel(Identity(), other.certificate); };
  EXPECT_EQ(asked({by_other(), "root-token"}), StatusCode::UNAVAILABLE) << "nobody has shown that one yet";
  server.put_certificate(&other);
  EXPECT_TRUE(comes(by_other, StatusCode::OK, "root-token"));
  EXPECT_EQ(asked({server.channel(), "root-token"}), StatusCode::UNAVAILABLE) << "the former is gone";
  for (int k = 0; k < 3; ++k) EXPECT_TRUE(watching.goes_on());
}

TEST(NewClientAuthority, LetsItsClientsInAndTheFormersOut) {
  GuardedServer server(Transport::kMutualTls, kEntries);
  Watching watching(server.as("root"));
  ASSERT_TRUE(watching.goes_on());
  const Identity other = make_authority("other");
  const Identity client = make_client(other, "root");
  const auto of_other = [&] { return server.channel(client); };
  EXPECT_EQ(asked({of_other()}), StatusCode::UNAVAILABLE);
  server.put_client_authority(other);
  EXPECT_TRUE(comes(of_other, StatusCode::OK));
  EXPECT_EQ(asked(server.as("root")), StatusCode::UNAVAILABLE);
  for (int k = 0; k < 3; ++k) EXPECT_TRUE(watching.goes_on());
}

// A handshake is asked once; a call, once a second.
TEST(ClientCertificate, EndsTheCallsThatItBegan) {
  GuardedServer server(Transport::kMutualTls, kEntries);
  Watching watching(server.as("root"));
  ASSERT_TRUE(watching.goes_on());
  server.let_pass(std::chrono::hours(25));
  while (watching.goes_on()) {
  }
}

TEST(TlsFiles, ThatDoNotFitAreRefusedAtTheStart) {
  AccessFolder folder;
  const Identity authority = make_authority("test"), server = make_server(authority);
  ListenOptions options;
  options.tls_certificate = folder.put("cert.pem", server.certificate);
  options.tls_key = folder.put("key.pem", server.key);
  EXPECT_TRUE(credentials_of(options));
  const auto refused = [](ListenOptions o, const char* word) {
    try {
      credentials_of(o);
      ADD_FAILURE() << "not refused with " << word;
    } catch (const std::runtime_error& error) {
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
    }
  };
  options.tls_client_ca = folder / "absent.pem";
  refused(options, "--tls-client-ca");
  options.tls_client_ca = options.tls_key;
  refused(options, "--tls-client-ca");
  options.tls_client_ca = folder.put("ca.pem", authority.certificate);
  EXPECT_TRUE(credentials_of(options));
  options.tls_key = folder.put("other.pem", authority.key);
  refused(options, "do not fit");
}

// What gRPC reads is a copy, of files alone that fit.
TEST(TlsFiles, UnfitFilesAreNotTakenAndTheNextAre) {
  AccessFolder folder;
  const Identity authority = make_authority("test");
  const auto text_of = [](const std::string& path) {
    std::ifstream in(path, std::ios::binary);
    return std::string{std::istreambuf_iterator<char>(in), {}};
  };
  const auto put = [&](const Identity& made) {
    folder.put("key.pem", made.key);
    folder.put("cert.pem", made.certificate);
  };
  ListenOptions options;
  options.tls_certificate = folder / "cert.pem";
  options.tls_key = folder / "key.pem";
  options.tls_client_ca = folder.put("ca.pem", authority.certificate);
  Identity serves = make_server(authority);
  put(serves);
  TlsFiles files(options, std::chrono::milliseconds(5));
  const auto comes = [](const auto& it) {
    const auto give_up = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (!it() && std::chrono::steady_clock::now() < give_up)
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    return it();
  };
  for (const char* name : {"key.pem", "cert.pem", "ca.pem"})
    for (const std::string what : {"pipe", "/dev/zero", "too much", "another's"}) {
      const auto path = folder / name;
      std::filesystem::remove(path);
      if (what == "pipe") {
        ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0);
      } else if (what == "too much") {
        std::ofstream(path).close();
        std::filesystem::resize_file(path, std::uintmax_t{3} << 30);
      } else if (what == "another's") {
        folder.put(name, std::string(name) == "cert.pem"  ? authority.certificate
                         : std::string(name) == "key.pem" ? authority.key
                                                          : serves.key);
      } else {
        std::filesystem::create_symlink(what, path);
      }
      const std::uint64_t before = files.looks();
      EXPECT_TRUE(comes([&] { return files.looks() > before + 1; })) << name << ", " << what;
      EXPECT_EQ(text_of(files.key()), serves.key) << name << ", " << what;
      EXPECT_EQ(text_of(files.certificate()), serves.certificate) << name << ", " << what;
      EXPECT_EQ(text_of(files.client_ca()), authority.certificate) << name << ", " << what;
      folder.put("ca.pem", authority.certificate);
      serves = make_server(authority);
      put(serves);
      EXPECT_TRUE(comes([&] { return text_of(files.certificate()) == serves.certificate; })) << name << what;
      EXPECT_EQ(text_of(files.key()), serves.key);
    }
}

}  // namespace
}  // namespace teletact::service
