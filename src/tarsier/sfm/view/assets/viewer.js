(()=>{'use strict';
const root=document.currentScript.parentElement,$=s=>root.querySelector(s);
const data=JSON.parse($('.tv-data').textContent);
const bytes=s=>Uint8Array.from(atob(s),c=>c.charCodeAt(0));
const N=data.drawn,range=data.range,quant=new Uint16Array(bytes(data.positions).buffer),rgb=bytes(data.colors);
const wires=new Float32Array(bytes(data.cameras).buffer),names=data.names,M=names.length;
const EDGES=[0,1,0,2,0,3,0,4,1,2,2,3,3,4,4,1],TAN=Math.tan(20*Math.PI/180);
let canvas=$('canvas'),legend=$('.tv-legend'),tip=$('.tv-tip'),list=$('.tv-cams ol');
let inside=root.classList.contains('tv-part');
try{inside=inside||window.self!==window.top}catch(e){inside=true}

// The view: an eye at distance d from the target t, in the frame of the cloud (y is up).
let yaw,pitch,d,t,width=1,height=1,dpr=1,wantCams=true,lit=-1,dirty=false,painter=null,untouched=true;
const clamp=(x,a,b)=>Math.min(b,Math.max(a,x));
const focal=()=>.5*Math.min(width,height)/TAN;   // css px
function fitting(p){
  const tx=.5*width/focal(),ty=.5*height/focal(),tilt=Math.abs(Math.sin(p)),level=Math.cos(p);
  return 1.08*Math.max(data.radius*Math.hypot(1,tx)/tx,(data.height*level+data.radius*tilt)/ty+.5*data.radius*level);
}
function reset(){yaw=0;pitch=.26;t=[0,0,0];d=fitting(pitch);untouched=true;need()}
function axes(){
  const s=Math.sin(yaw),c=Math.cos(yaw),st=Math.sin(pitch),ct=Math.cos(pitch);
  return {x:[c,0,-s],y:[-st*s,ct,-st*c],z:[ct*s,st,ct*c]};
}
const dot=(a,x,y,z)=>a[0]*x+a[1]*y+a[2]*z;
// Of a point: px right and down from the corner, and the distance ahead of the eye.
function projector(){
  const a=axes(),f=focal(),cx=width/2,cy=height/2,tx=dot(a.x,...t),ty=dot(a.y,...t),tz=dot(a.z,...t);
  return (x,y,z,out)=>{
    const w=d-(dot(a.z,x,y,z)-tz);
    out[0]=cx+f*(dot(a.x,x,y,z)-tx)/w;out[1]=cy-f*(dot(a.y,x,y,z)-ty)/w;out[2]=w;
  };
}
const style=name=>getComputedStyle(root).getPropertyValue(name).trim();
const hex=s=>[1,3,5].map(i=>parseInt(s.substr(i,2),16)/255);
// Side of a point at distance 1, css px: gaps close where the cloud fills the view.
const pointSize=n=>{const fit=fitting(.26);
  return clamp(1.25*Math.sqrt(.35*width*height/Math.max(1,n)),1.6,7)*fit};

function webgl(){
  const gl=canvas.getContext('webgl',{antialias:true,alpha:false});
  if(!gl)return null;
  const shader=(kind,text)=>{const s=gl.createShader(kind);gl.shaderSource(s,text);gl.compileShader(s);return s};
  const program=(v,f,names)=>{
    const p=gl.createProgram();gl.attachShader(p,shader(gl.VERTEX_SHADER,v));gl.attachShader(p,shader(gl.FRAGMENT_SHADER,f));
    gl.bindAttribLocation(p,0,'a');gl.bindAttribLocation(p,1,'b');gl.linkProgram(p);
    if(!gl.getProgramParameter(p,gl.LINK_STATUS))throw new Error('shader');
    const u={p};for(const n of names)u[n]=gl.getUniformLocation(p,n);return u;
  };
  const dots=program(
    'attribute vec3 a;attribute vec3 b;uniform mat4 m;uniform float range,size,eye;varying vec4 c;'+
    'void main(){gl_Position=m*vec4((a*2.-1.)*range,1.);'+
    'gl_PointSize=clamp(size/gl_Position.w,1.,40.);c=vec4(b,clamp((gl_Position.w-eye+1.)*.5,0.,1.)*.3);}',
    'precision mediump float;varying vec4 c;uniform vec3 paper;'+
    'void main(){vec2 q=gl_PointCoord*2.-1.;if(dot(q,q)>1.3)discard;gl_FragColor=vec4(mix(c.rgb,paper,c.a),1.);}',
    ['m','range','size','eye','paper']);
  const lines=program('attribute vec3 a;uniform mat4 m;void main(){gl_Position=m*vec4(a,1.);}',
    'precision mediump float;uniform vec4 ink;void main(){gl_FragColor=ink;}',['m','ink']);
  const buffer=values=>{const b=gl.createBuffer();gl.bindBuffer(gl.ARRAY_BUFFER,b);
    gl.bufferData(gl.ARRAY_BUFFER,values,gl.STATIC_DRAW);return b};
  // Four numbers each: graphics chips want them aligned.
  const p4=new Uint16Array(4*N),c4=new Uint8Array(4*N);
  for(let i=0;i<N;i++)for(let k=0;k<3;k++){p4[4*i+k]=quant[3*i+k];c4[4*i+k]=rgb[3*i+k]}
  const ends=new Float32Array(M*48);
  for(let i=0;i<M;i++)EDGES.forEach((v,e)=>ends.set(wires.subarray(15*i+3*v,15*i+3*v+3),48*i+3*e));
  const positions=buffer(p4),colors=buffer(c4),segments=buffer(ends);
  gl.enable(gl.DEPTH_TEST);gl.depthFunc(gl.LEQUAL);gl.blendFunc(gl.SRC_ALPHA,gl.ONE_MINUS_SRC_ALPHA);
  return ()=>{
    const paper=hex(style('--tv-paper')),a=axes(),near=.01*d,far=d+60,f=focal();
    gl.viewport(0,0,canvas.width,canvas.height);
    gl.clearColor(paper[0],paper[1],paper[2],1);gl.depthMask(true);gl.clear(gl.COLOR_BUFFER_BIT|gl.DEPTH_BUFFER_BIT);
    // Columns of projection times view.
    const fx=2*f/width,fy=2*f/height,A=-(far+near)/(far-near),B=-2*far*near/(far-near);
    const ox=-dot(a.x,...t),oy=-dot(a.y,...t),oz=-dot(a.z,...t)-d,m=new Float32Array(16);
    for(let k=0;k<3;k++){m[4*k]=fx*a.x[k];m[4*k+1]=fy*a.y[k];m[4*k+2]=A*a.z[k];m[4*k+3]=-a.z[k]}
    m[12]=fx*ox;m[13]=fy*oy;m[14]=A*oz+B;m[15]=-oz;
    gl.disable(gl.BLEND);gl.useProgram(dots.p);gl.uniformMatrix4fv(dots.m,false,m);gl.uniform1f(dots.range,range);
    gl.uniform1f(dots.size,pointSize(N)*dpr);gl.uniform1f(dots.eye,d);gl.uniform3fv(dots.paper,paper);
    gl.enableVertexAttribArray(0);gl.enableVertexAttribArray(1);
    gl.bindBuffer(gl.ARRAY_BUFFER,positions);gl.vertexAttribPointer(0,3,gl.UNSIGNED_SHORT,true,8,0);
    gl.bindBuffer(gl.ARRAY_BUFFER,colors);gl.vertexAttribPointer(1,3,gl.UNSIGNED_BYTE,true,4,0);
    if(N)gl.drawArrays(gl.POINTS,0,N);
    if(!M||!(wantCams||lit>=0))return;
    gl.disableVertexAttribArray(1);gl.useProgram(lines.p);gl.uniformMatrix4fv(lines.m,false,m);
    gl.bindBuffer(gl.ARRAY_BUFFER,segments);gl.vertexAttribPointer(0,3,gl.FLOAT,false,12,0);
    const ink=hex(style('--tv-accent')),mark=hex(style('--tv-mark'));
    gl.enable(gl.BLEND);gl.depthMask(false);
    if(wantCams){
      gl.uniform4f(lines.ink,...ink,1);gl.drawArrays(gl.LINES,0,16*M);
      // Once more, faintly, where points hide them.
      gl.depthFunc(gl.GREATER);gl.uniform4f(lines.ink,...ink,.2);gl.drawArrays(gl.LINES,0,16*M);gl.depthFunc(gl.LEQUAL);
    }
    if(lit>=0){gl.disable(gl.DEPTH_TEST);gl.uniform4f(lines.ink,...mark,1);gl.drawArrays(gl.LINES,16*lit,16);gl.enable(gl.DEPTH_TEST)}
  };
}

// Without WebGL: the farthest points first.
function plain(){
  const g=canvas.getContext('2d');
  if(!g)return null;
  const n=Math.min(N,15000),BINS=2048,out=[0,0,0];
  const at=new Float32Array(3*n),bin=new Uint16Array(n),order=new Uint32Array(n),count=new Uint32Array(BINS+1);
  return ()=>{
    const paper=style('--tv-paper'),pc=hex(paper).map(v=>v*255),project=projector(),size=pointSize(n),near=.01*d;
    g.setTransform(dpr,0,0,dpr,0,0);g.fillStyle=paper;g.fillRect(0,0,width,height);
    count.fill(0);
    const from=Math.max(near,d-2.5),to=d+2.5;
    for(let i=0;i<n;i++){
      project((quant[3*i]/32767.5-1)*range,(quant[3*i+1]/32767.5-1)*range,(quant[3*i+2]/32767.5-1)*range,out);
      at.set(out,3*i);
      bin[i]=BINS-1-Math.floor(clamp((out[2]-from)/(to-from),0,.9999)*BINS);count[bin[i]+1]++;
    }
    for(let i=0;i<BINS;i++)count[i+1]+=count[i];
    for(let i=0;i<n;i++)order[count[bin[i]]++]=i;
    for(const i of order){
      const w=at[3*i+2];
      if(w<near)continue;
      const s=clamp(size/w,1,40),k=clamp((w-d+1)*.5,0,1)*.3;
      g.fillStyle='rgb('+[0,1,2].map(c=>Math.round(rgb[3*i+c]+k*(pc[c]-rgb[3*i+c])))+')';
      g.fillRect(at[3*i]-s/2,at[3*i+1]-s/2,s,s);
    }
    g.lineWidth=1.2;
    const p=[0,0,0],q=[0,0,0];
    const wire=i=>{
      g.beginPath();
      for(let e=0;e<16;e+=2){
        const a=15*i+3*EDGES[e],b=15*i+3*EDGES[e+1];
        project(wires[a],wires[a+1],wires[a+2],p);project(wires[b],wires[b+1],wires[b+2],q);
        if(p[2]>near&&q[2]>near){g.moveTo(p[0],p[1]);g.lineTo(q[0],q[1])}
      }
      g.stroke();
    };
    g.strokeStyle=style('--tv-accent');
    if(wantCams)for(let i=0;i<M;i++)wire(i);
    if(lit>=0){g.strokeStyle=style('--tv-mark');g.lineWidth=2;wire(lit)}
  };
}

function need(){
  if(dirty)return;
  dirty=true;
  requestAnimationFrame(()=>{dirty=false;if(painter)painter()});
}
function resize(){
  const box=root.getBoundingClientRect();
  if(!box.width||!box.height)return;
  width=box.width;height=box.height;dpr=Math.min(2,window.devicePixelRatio||1);
  canvas.width=Math.round(width*dpr);canvas.height=Math.round(height*dpr);
  if(untouched)reset();
  need();
}

function light(i,scroll){
  if(i===lit)return;
  if(list.children[lit])list.children[lit].classList.remove('tv-on');
  lit=i;
  const item=i>=0&&i<data.listed?list.children[i]:null;
  if(item){item.classList.add('tv-on');
    // Not scrollIntoView(): that would move the page around this view as well.
    if(scroll)list.scrollTop=clamp(list.scrollTop,item.offsetTop+item.offsetHeight-list.offsetTop-list.clientHeight,item.offsetTop-list.offsetTop)}
  need();
}
// Stands where an image was taken, and looks along.
function stand(i){
  const w=wires.subarray(15*i,15*i+15),e=[w[0],w[1],w[2]],a=[0,1,2].map(k=>w[3+k]+w[6+k]+w[9+k]+w[12+k]-4*w[k]);
  const n=Math.hypot(...a)||1,ahead=a.map(v=>v/n);
  d=Math.max(.2,-dot(ahead,...e));t=e.map((v,k)=>v+d*ahead[k]);
  yaw=Math.atan2(-ahead[0],-ahead[2]);pitch=clamp(Math.asin(clamp(-ahead[1],-1,1)),-1.55,1.55);
  untouched=false;need();
}
function hover(x,y){
  let best=-1,least=16*16;
  if(wantCams){
    const project=projector(),out=[0,0,0];
    for(let i=0;i<M;i++){
      project(wires[15*i],wires[15*i+1],wires[15*i+2],out);
      const r=(out[0]-x)**2+(out[1]-y)**2;
      if(out[2]>0&&r<least){least=r;best=i}
    }
  }
  light(best,true);
  tip.hidden=best<0;
  if(best>=0){
    tip.textContent=names[best];
    tip.style.left=clamp(x+14,4,Math.max(4,width-tip.offsetWidth-4))+'px';
    tip.style.top=(y>40?y-34:y+18)+'px';
  }
}

const turn=(dx,dy)=>{yaw-=dx*.0075;pitch=clamp(pitch+dy*.0075,-1.55,1.55)};
const move=(dx,dy)=>{const a=axes(),s=d/focal();t=t.map((v,k)=>v-s*dx*a.x[k]+s*dy*a.y[k])};
const zoom=f=>{d=clamp(d*f,.02,40)};
const down=new Map();
let awake=!inside;
function listen(){
  canvas.classList.toggle('tv-inside',inside);
  const on=(type,f,options)=>canvas.addEventListener(type,f,options);
  const local=e=>{const b=canvas.getBoundingClientRect();return [e.clientX-b.left,e.clientY-b.top]};
  on('pointerdown',e=>{awake=true;down.set(e.pointerId,local(e));
    try{canvas.setPointerCapture(e.pointerId)}catch(x){}
    tip.hidden=true});
  on('pointermove',e=>{
    const p=local(e),q=down.get(e.pointerId);
    if(!q){if(e.pointerType!=='touch')hover(...p);return}
    const dx=p[0]-q[0],dy=p[1]-q[1];
    if(!dx&&!dy)return;
    untouched=false;
    if(down.size===2){
      const o=[...down].find(([id])=>id!==e.pointerId)[1];
      zoom(Math.hypot(q[0]-o[0],q[1]-o[1])/Math.max(1,Math.hypot(p[0]-o[0],p[1]-o[1])));
      move(dx/2,dy/2);
    }else if(e.shiftKey||(e.buttons&6))move(dx,dy);
    else turn(dx,dy);
    down.set(e.pointerId,p);need();
  });
  const up=e=>down.delete(e.pointerId);
  on('pointerup',up);on('pointercancel',up);on('lostpointercapture',up);
  on('pointerleave',()=>{if(!down.size){light(-1);tip.hidden=true;awake=!inside}});
  on('wheel',e=>{
    // On another page the wheel is that page's, until this view was clicked.
    if(!awake&&!e.ctrlKey)return;
    e.preventDefault();untouched=false;
    zoom(Math.exp(clamp(e.deltaY*(e.deltaMode===1?30:e.deltaMode===2?300:1),-240,240)*.0015));need();
  },{passive:false});
  on('contextmenu',e=>e.preventDefault());
  on('dblclick',reset);
  on('keydown',e=>{
    const step={ArrowLeft:[16,0],ArrowRight:[-16,0],ArrowUp:[0,16],ArrowDown:[0,-16]}[e.key];
    if(step){if(e.shiftKey)move(...step);else turn(...step)}
    else if(e.key==='+'||e.key==='=')zoom(.9);
    else if(e.key==='-')zoom(1/.9);
    else if(e.key==='0'){reset();return}
    else return;
    untouched=false;e.preventDefault();need();
  });
  on('webglcontextlost',e=>{e.preventDefault();painter=null});
  on('webglcontextrestored',()=>start());
}
function start(){
  let plainly=false;
  painter=null;
  try{if(location.hash!=='#2d')painter=webgl()}catch(e){
    // A canvas that once was WebGL never gives a plain one.
    const fresh=canvas.cloneNode();canvas.replaceWith(fresh);canvas=fresh;listen();
  }
  if(!painter){painter=plain();plainly=!!painter}
  root.dataset.painter=painter?(plainly?'canvas':'webgl'):'none';
  if(plainly&&N>15000)$('.tv-drawn').textContent=data.plainly;
  resize();
}

$('.tv-reset').onclick=reset;
const shown=$('.tv-show'),listed=$('.tv-list');
shown.onclick=()=>{wantCams=!wantCams;shown.setAttribute('aria-pressed',wantCams);need()};
listed.onclick=()=>{list.hidden=!list.hidden;listed.setAttribute('aria-pressed',!list.hidden)};
for(let i=0;i<data.listed;i++){
  const item=document.createElement('li'),button=document.createElement('button');
  button.type='button';button.textContent=button.title=names[i];
  button.onclick=()=>stand(i);
  button.onmouseenter=button.onfocus=()=>light(i);
  button.onmouseleave=button.onblur=()=>light(-1);
  item.append(button);list.append(item);
}
if(M>data.listed){
  const item=document.createElement('li');item.className='tv-more';item.textContent='and '+(M-data.listed)+' more';list.append(item);
}
if(!M)shown.hidden=listed.hidden=true;
listen();reset();start();
window.addEventListener('resize',resize);
if(window.ResizeObserver)new ResizeObserver(resize).observe(root);
if(window.matchMedia){const dark=matchMedia('(prefers-color-scheme: dark)');
  if(dark.addEventListener)dark.addEventListener('change',need)}
})();
