"""The design service: a lab submits missions, follows races and keeps designs. Nothing imports it.

settings      limits and workers, from serve.yaml
records       folders with a JSON file each
database      SQLite files, which can be made again
jobs/         jobs: their files, their index, the scheduler, the processes that run races
accounts/     users, tokens, sessions, the guard in front of every request
designs       FSMs that users keep
workers/      worker processes for short work: previews, evaluations, replays, reports
service       its parts, put together
http/         the HTTP API
web/          the pages and their assets
app           the application: API and pages behind the guard
client/       the client of a service: requests, events, files
cli/          serve, users, and the client: submit, jobs, follow, fetch
"""
