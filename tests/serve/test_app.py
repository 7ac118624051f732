def test_the_list_of_jobs_is_empty_at_first(client):
    assert client.get("/api/v1/jobs").json() == {"jobs": [], "total": 0}
