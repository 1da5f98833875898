// SPDX-License-Identifier: Apache-2.0
#include "jade/serve/render_queue.h"

#include <algorithm>
#include <exception>
#include <utility>

namespace jade::serve {
namespace {

constexpr auto kPresence = std::chrono::seconds(10);
constexpr size_t kMostViewers = 64;

}  // namespace

void RenderQueue::finish(Waiting::iterator at) {
  (*at)->done = true;
  requests_.erase(at);
  waiting_ = requests_.size();
}

bool RenderQueue::wait(Seconds at_most) {
  std::unique_lock<std::mutex> lock(mutex_);
  const bool was_paused = paused_;
  asked_.wait_for(lock, at_most, [&] { return !requests_.empty() || paused_ != was_paused; });
  return !requests_.empty();
}

void RenderQueue::render_one(const Render& render) {
  std::shared_ptr<Request> request;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (requests_.empty()) return;
    request = requests_.front();
  }
  Answer answer;
  try {
    answer.rendered = render(request->wanted);
    answer.kind = Answer::Kind::kRendered;
  } catch (const NotYet&) {
    answer.kind = Answer::Kind::kTooLate;
  } catch (const std::exception& problem) {
    answer.kind = Answer::Kind::kFailed;
    answer.reason = problem.what();
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto at = std::find(requests_.begin(), requests_.end(), request);
  if (at == requests_.end()) return;  // a newer one has taken its place
  request->answer = std::move(answer);
  finish(at);
  answered_.notify_all();
}

Answer RenderQueue::ask(const std::string& key, const Wanted& wanted, Seconds at_most) {
  auto request = std::make_shared<Request>();
  request->key = key;
  request->wanted = wanted;
  std::unique_lock<std::mutex> lock(mutex_);
  const auto older = std::find_if(requests_.begin(), requests_.end(),
                                  [&](const auto& other) { return other->key == key; });
  if (older != requests_.end()) {
    finish(older);
    answered_.notify_all();
  }
  if (closed_) return {};
  if (requests_.size() >= kMostWaiting) return {Answer::Kind::kFull, {}, {}};
  requests_.push_back(request);
  waiting_ = requests_.size();
  asked_.notify_all();
  answered_.wait_for(lock, at_most, [&] { return request->done; });
  if (!request->done) finish(std::find(requests_.begin(), requests_.end(), request));
  return std::move(request->answer);
}

void RenderQueue::set_paused(bool paused) {
  const std::lock_guard<std::mutex> lock(mutex_);
  paused_ = paused;
  asked_.notify_all();
}

void RenderQueue::note(const std::string& viewer) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const Clock::time_point now = Clock::now();
  last_seen_ = now;
  for (auto at = seen_.begin(); at != seen_.end();) {
    at = now - at->second > kPresence ? seen_.erase(at) : std::next(at);
  }
  if (seen_.size() < kMostViewers || seen_.count(viewer) > 0) seen_[viewer] = now;
}

int64_t RenderQueue::viewers() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const Clock::time_point now = Clock::now();
  return std::count_if(seen_.begin(), seen_.end(),
                       [&](const auto& one) { return now - one.second <= kPresence; });
}

RenderQueue::Seconds RenderQueue::silence() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return Clock::now() - last_seen_;
}

void RenderQueue::close() {
  const std::lock_guard<std::mutex> lock(mutex_);
  closed_ = true;
  while (!requests_.empty()) finish(requests_.begin());
  answered_.notify_all();
  asked_.notify_all();
}

}  // namespace jade::serve
