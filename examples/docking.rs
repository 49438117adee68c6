//! Docking under guidance: `sherpa` guides `crex` to one of its interfaces, action by action, and
//! `ground` watches how the actions of `crex` go.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use fipa::prelude::*;
use fipa::{Answer, ConversationError, Order};
use fipa_actions::{Action, Content, LANGUAGE, Limits, Signature, Task, TaskState, parse};
use tokio::sync::broadcast;

const PATIENCE: Duration = Duration::from_secs(10);

/// What `crex` can do.
const ACTIONS: &str = r#"actions
  approach(target: text, distance: number) "Drive towards another robot, up to so many metres."
  turn(degrees: number) "Turn where it stands."
  dock(target: text, emi: number) "Drive to an interface and lock it.""#;

type Failure = Box<dyn std::error::Error>;

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Failure> {
    let field = Platform::builder()
        .name("field")
        .mdns(false)
        .start()
        .await?;
    let crex = field.agent("crex").await?;
    tokio::spawn(async move { be_guided(crex).await });
    let ground = field.agent("ground").await?;
    let watching = tokio::spawn(async move {
        let seen = watch(&ground).await;
        seen.map_err(|error| error.to_string())
    });
    let sherpa = field.agent("sherpa").await?;
    guide(&sherpa).await?;
    for line in watching.await?? {
        println!("ground saw: {line}");
    }
    Ok(())
}

/// The master: asks what the other robot can do, and leads it to the interface.
async fn guide(sherpa: &Agent) -> Result<(), ConversationError> {
    let question = Content::AskActions(None);
    let answer = sherpa
        .query(message(Performative::QueryRef, &question), PATIENCE)
        .await?;
    println!("crex: {}", answer.content_str().unwrap_or_default());
    for order in [
        "do approach(target: sherpa, distance: 0.5)",
        "do turn(degrees: -12.5)",
        // Without the interface this is refused.
        "do dock(target: sherpa)",
        "do dock(target: sherpa, emi: 2)",
    ] {
        println!("sherpa: {order}");
        let order = Message::new(Performative::Request)
            .to("crex")
            .language(LANGUAGE)
            .content(order);
        match sherpa.perform(order, PATIENCE).await {
            Ok(done) => println!("crex: {}", done.content_str().unwrap_or_default()),
            Err(error @ ConversationError::Refused(_)) => println!("{error}"),
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Whoever watches: subscribes to the status of the tasks, until the robot has docked.
async fn watch(ground: &Agent) -> Result<Vec<String>, ConversationError> {
    let subscription = message(Performative::Subscribe, &Content::AskStatus(None));
    let mut news = ground.subscribe(subscription, PATIENCE).await?;
    let mut seen = Vec::new();
    while let Some(told) = news.next().await {
        let told = told?;
        let text = told.content_str().unwrap_or_default();
        let Ok(Content::Status(tasks)) = parse(text, &Limits::default()) else {
            continue;
        };
        seen.extend(tasks.iter().map(Task::to_string));
        let has_docked =
            |task: &Task| task.action.name.as_str() == "dock" && task.state == TaskState::Done;
        if tasks.iter().any(has_docked) {
            break;
        }
    }
    // Here the subscription is dropped, and so cancelled.
    Ok(seen)
}

fn message(act: Performative, content: &Content) -> Message {
    let message = Message::new(act).to("crex").language(LANGUAGE);
    message.content(content.to_string())
}

/// The robot that is guided.
#[derive(Clone)]
struct Client {
    actions: Arc<Vec<Signature>>,
    tasks: Arc<Mutex<Vec<Task>>>,
    changes: broadcast::Sender<Task>,
}

async fn be_guided(crex: Agent) {
    let Ok(Content::Actions(actions)) = parse(ACTIONS, &Limits::default()) else {
        unreachable!("the actions are well written")
    };
    let client = Client {
        actions: Arc::new(actions),
        tasks: Arc::default(),
        changes: broadcast::Sender::new(64),
    };
    let (acting, asked, watched) = (client.clone(), client.clone(), client);
    crex.respond()
        .request(move |order| acting.clone().act(order))
        .query(move |order| asked.clone().answer(order))
        .subscribe(move |order| watched.clone().report(order))
        .run()
        .await;
}

impl Client {
    async fn act(self, order: Order) -> Result<Answer, ConversationError> {
        let action = match read(&order) {
            Ok(Content::Do(action)) => action,
            Ok(_) => return Ok(Answer::not_understood("this is no action")),
            Err(error) => return Ok(Answer::not_understood(error)),
        };
        let known = self.actions.iter().find(|known| known.name == action.name);
        match known.map(|known| known.check(&action)) {
            None => return Ok(Answer::refuse("crex has no such action")),
            Some(Err(mismatch)) => return Ok(Answer::refuse(mismatch.to_string())),
            Some(Ok(())) => order.agree().await?,
        }
        // Nobody is there yet who could watch.
        while self.changes.receiver_count() == 0 {
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        let mut task = self.begin(action);
        for (state, percent) in [
            (TaskState::Running, Some(0)),
            (TaskState::Running, Some(50)),
            (TaskState::Done, None),
        ] {
            (task.state, task.percent) = (state, percent);
            self.update(&task);
            // As long as the wheels turn.
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        Ok(Answer::inform(Content::Status(vec![task]).to_string()))
    }

    async fn answer(self, order: Order) -> Result<Answer, ConversationError> {
        let content = match read(&order) {
            Ok(Content::AskActions(name)) => {
                let is_meant = |one: &&Signature| name.as_ref().is_none_or(|n| *n == one.name);
                let actions = self.actions.iter().filter(is_meant);
                Content::Actions(actions.cloned().collect())
            }
            Ok(Content::AskStatus(number)) => {
                let is_meant = |one: &Task| number.is_none_or(|n| n == one.number);
                let mut tasks = self.tasks();
                tasks.retain(is_meant);
                Content::Status(tasks)
            }
            Ok(_) => return Ok(Answer::not_understood("this is no question")),
            Err(error) => return Ok(Answer::not_understood(error)),
        };
        Ok(Answer::inform(content.to_string()))
    }

    async fn report(self, order: Order) -> Result<Answer, ConversationError> {
        let mut changes = self.changes.subscribe();
        order.agree().await?;
        while let Ok(task) = changes.recv().await {
            order
                .inform(Content::Status(vec![task]).to_string())
                .await?;
        }
        Ok(Answer::failure("the news came too fast"))
    }

    fn begin(&self, action: Action) -> Task {
        let mut tasks = self.tasks.lock().unwrap_or_else(PoisonError::into_inner);
        let task = Task {
            number: tasks.len() as u32 + 1,
            state: TaskState::Waiting,
            percent: None,
            action,
        };
        tasks.push(task.clone());
        task
    }

    fn update(&self, task: &Task) {
        let mut tasks = self.tasks.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = tasks.iter_mut().find(|known| known.number == task.number) {
            known.clone_from(task);
        }
        // The robot moves also when nobody watches.
        let _ = self.changes.send(task.clone());
    }

    fn tasks(&self) -> Vec<Task> {
        let tasks = self.tasks.lock().unwrap_or_else(PoisonError::into_inner);
        tasks.clone()
    }
}

fn read(order: &Order) -> Result<Content, String> {
    let text = order.message().content_str().unwrap_or_default();
    parse(text, &Limits::default()).map_err(|error| error.to_string())
}
