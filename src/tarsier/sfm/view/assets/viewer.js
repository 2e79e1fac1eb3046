(()=>{'use strict';
const root=document.currentScript.parentElement,$=s=>root.querySelector(s);
const data=JSON.parse($('.tv-data').textContent);
const bytes=s=>Uint8Array.from(atob(s),c=>c.charCodeAt(0));
// Clouds: points in 16 bits a coordinate, of -range to range.
const cloudOf=c=>({n:c.drawn,range:c.range,quant:new Uint16Array(bytes(c.positions).buffer),rgb:bytes(c.colors)});
const clouds={points:cloudOf(data)};
if(data.cloud)clouds.cloud=cloudOf(data.cloud);
let mesh=null;
if(data.mesh){
  const m=data.mesh,floats=s=>new Float32Array(bytes(s).buffer);
  mesh={at:floats(m.positions),rgb:bytes(m.colors),uv:m.texture?floats(m.uvs):null,index:new Uint32Array(bytes(m.indices).buffer),texture:m.texture};
}
const on={points:!data.cloud&&!mesh,cloud:!!data.cloud&&!mesh,mesh:!!mesh};
const wires=new Float32Array(bytes(data.cameras).buffer),names=data.names,M=names.length;
const EDGES=[0,1,0,2,0,3,0,4,1,2,2,3,3,4,4,1],TAN=Math.tan(20*Math.PI/180);
let canvas=$('canvas'),legend=$('.tv-legend'),tip=$('.tv-tip'),list=$('.tv-cams ol'),over=$('.tv-over');
let inside=true;
try{inside=window.self!==window.top}catch(e){}

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
    'attribute vec3 a;attribute vec3 b;uniform mat4 m;uniform float range,size,eye;uniform vec3 low,high;varying vec4 c;'+
    'void main(){vec3 p=(a*2.-1.)*range;gl_Position=any(lessThan(p,low))||any(greaterThan(p,high))?vec4(2.,2.,2.,1.):m*vec4(p,1.);'+
    'gl_PointSize=clamp(size/gl_Position.w,1.,40.);c=vec4(b,clamp((gl_Position.w-eye+1.)*.5,0.,1.)*.3);}',
    'precision mediump float;varying vec4 c;uniform vec3 paper;'+
    'void main(){vec2 q=gl_PointCoord*2.-1.;if(dot(q,q)>1.3)discard;gl_FragColor=vec4(mix(c.rgb,paper,c.a),1.);}',
    ['m','range','size','eye','paper','low','high']);
  // A texture as it is, as the images hold the light; colours of vertices else.
  const faces=mesh&&program(
    'attribute vec3 a;attribute vec3 b;uniform mat4 m;varying vec3 c,p;void main(){p=a;c=b;gl_Position=m*vec4(a,1.);}',
    'precision mediump float;varying vec3 c;varying highp vec3 p;uniform highp vec3 low,high;uniform sampler2D image;uniform float textured;'+
    'void main(){if(any(lessThan(p,low))||any(greaterThan(p,high)))discard;'+
    'gl_FragColor=vec4(mix(c,texture2D(image,c.xy).rgb,textured),1.);}',
    ['m','low','high','image','textured']);
  const lines=program('attribute vec3 a;uniform mat4 m;void main(){gl_Position=m*vec4(a,1.);}',
    'precision mediump float;uniform vec4 ink;void main(){gl_FragColor=ink;}',['m','ink']);
  const buffer=(values,kind=gl.ARRAY_BUFFER)=>{const b=gl.createBuffer();gl.bindBuffer(kind,b);
    gl.bufferData(kind,values,gl.STATIC_DRAW);return b};
  // Four numbers each: graphics chips want them aligned.
  const fours=(values,n,Kind)=>{const four=new Kind(4*n);
    for(let i=0;i<n;i++)for(let k=0;k<3;k++)four[4*i+k]=values[3*i+k];
    return buffer(four)};
  const loaded=Object.entries(clouds).map(([name,c])=>({name,n:c.n,range:c.range,
    positions:fours(c.quant,c.n,Uint16Array),colors:fours(c.rgb,c.n,Uint8Array)}));
  let solid=null;
  if(mesh&&gl.getExtension('OES_element_index_uint')){
    solid={a:buffer(mesh.at),b:mesh.uv?buffer(mesh.uv):fours(mesh.rgb,mesh.at.length/3,Uint8Array),
      index:buffer(mesh.index,gl.ELEMENT_ARRAY_BUFFER),ready:!mesh.texture,image:gl.createTexture()};
    if(mesh.texture){
      const picture=new Image();
      picture.onload=()=>{
        const most=gl.getParameter(gl.MAX_TEXTURE_SIZE),shrink=Math.min(1,most/Math.max(picture.width,picture.height));
        let source=picture;
        if(shrink<1){source=document.createElement('canvas');source.width=Math.floor(picture.width*shrink);
          source.height=Math.floor(picture.height*shrink);source.getContext('2d').drawImage(picture,0,0,source.width,source.height)}
        gl.bindTexture(gl.TEXTURE_2D,solid.image);
        gl.texImage2D(gl.TEXTURE_2D,0,gl.RGB,gl.RGB,gl.UNSIGNED_BYTE,source);
        for(const side of [gl.TEXTURE_WRAP_S,gl.TEXTURE_WRAP_T])gl.texParameteri(gl.TEXTURE_2D,side,gl.CLAMP_TO_EDGE);
        gl.texParameteri(gl.TEXTURE_2D,gl.TEXTURE_MIN_FILTER,gl.LINEAR);
        solid.ready=true;root.dataset.texture='ready';need();
      };
      picture.setAttribute('src','data:image/jpeg;base64,'+mesh.texture);
    }
  }
  const ends=new Float32Array(M*48);
  for(let i=0;i<M;i++)EDGES.forEach((v,e)=>ends.set(wires.subarray(15*i+3*v,15*i+3*v+3),48*i+3*e));
  const segments=buffer(ends);
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
    gl.disable(gl.BLEND);gl.useProgram(dots.p);gl.uniformMatrix4fv(dots.m,false,m);
    gl.uniform1f(dots.eye,d);gl.uniform3fv(dots.paper,paper);gl.uniform3fv(dots.low,cut.low);gl.uniform3fv(dots.high,cut.high);
    gl.enableVertexAttribArray(0);gl.enableVertexAttribArray(1);
    for(const c of loaded){
      if(!on[c.name]||!c.n)continue;
      gl.uniform1f(dots.range,c.range);gl.uniform1f(dots.size,pointSize(c.n)*dpr);
      gl.bindBuffer(gl.ARRAY_BUFFER,c.positions);gl.vertexAttribPointer(0,3,gl.UNSIGNED_SHORT,true,8,0);
      gl.bindBuffer(gl.ARRAY_BUFFER,c.colors);gl.vertexAttribPointer(1,3,gl.UNSIGNED_BYTE,true,4,0);
      gl.drawArrays(gl.POINTS,0,c.n);
    }
    if(solid&&solid.ready&&on.mesh){
      gl.useProgram(faces.p);gl.uniformMatrix4fv(faces.m,false,m);gl.uniform3fv(faces.low,cut.low);gl.uniform3fv(faces.high,cut.high);
      gl.uniform1f(faces.textured,mesh.uv?1:0);gl.bindTexture(gl.TEXTURE_2D,solid.image);
      gl.bindBuffer(gl.ARRAY_BUFFER,solid.a);gl.vertexAttribPointer(0,3,gl.FLOAT,false,12,0);
      gl.bindBuffer(gl.ARRAY_BUFFER,solid.b);
      if(mesh.uv)gl.vertexAttribPointer(1,2,gl.FLOAT,false,8,0);else gl.vertexAttribPointer(1,3,gl.UNSIGNED_BYTE,true,4,0);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER,solid.index);gl.drawElements(gl.TRIANGLES,mesh.index.length,gl.UNSIGNED_INT,0);
    }
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
  const BINS=2048,MOST=15000,out=[0,0,0];
  const at=new Float32Array(3*MOST),bin=new Uint16Array(MOST),order=new Uint32Array(MOST),count=new Uint32Array(BINS+1);
  // Of a surface its vertices, evenly.
  const every=mesh?Math.max(1,Math.ceil(mesh.at.length/3/MOST)):1;
  const shown=()=>{
    if(mesh&&on.mesh)return {n:Math.floor(mesh.at.length/3/every),rgb:mesh.rgb,step:every,put:(i,p)=>{for(let k=0;k<3;k++)p[k]=mesh.at[3*i*every+k]}};
    const c=clouds.cloud&&on.cloud?clouds.cloud:on.points?clouds.points:null;
    if(!c)return {n:0};
    return {n:Math.min(c.n,MOST),rgb:c.rgb,step:1,put:(i,p)=>{for(let k=0;k<3;k++)p[k]=(c.quant[3*i+k]/32767.5-1)*c.range}};
  };
  return ()=>{
    const what=shown(),n=what.n,rgb=what.rgb,point=[0,0,0];
    const paper=style('--tv-paper'),pc=hex(paper).map(v=>v*255),project=projector(),size=pointSize(n),near=.01*d;
    g.setTransform(dpr,0,0,dpr,0,0);g.fillStyle=paper;g.fillRect(0,0,width,height);
    count.fill(0);
    const from=Math.max(near,d-2.5),to=d+2.5;
    for(let i=0;i<n;i++){
      what.put(i,point);
      if(inCut(point))project(...point,out);else out[2]=-1;
      at.set(out,3*i);
      bin[i]=BINS-1-Math.floor(clamp((out[2]-from)/(to-from),0,.9999)*BINS);count[bin[i]+1]++;
    }
    for(let i=0;i<BINS;i++)count[i+1]+=count[i];
    for(let i=0;i<n;i++)order[count[bin[i]]++]=i;
    for(let o=0;o<n;o++){
      const i=order[o],w=at[3*i+2];
      if(w<near)continue;
      const s=clamp(size/w,1,40),k=clamp((w-d+1)*.5,0,1)*.3;
      g.fillStyle='rgb('+[0,1,2].map(c=>Math.round(rgb[3*i*what.step+c]+k*(pc[c]-rgb[3*i*what.step+c])))+')';
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
  requestAnimationFrame(()=>{dirty=false;if(painter)painter();drawOver()});
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

// What is cut away: all outside of a box in the frame of the cloud.
const FAR=1e4,cut={low:[-FAR,-FAR,-FAR],high:[FAR,FAR,FAR],on:false};
const inCut=p=>p.every((v,k)=>v>=cut.low[k]&&v<=cut.high[k]);
const box=(()=>{
  const low=[FAR,FAR,FAR],high=[-FAR,-FAR,-FAR],take=(v,k)=>{if(v<low[k])low[k]=v;if(v>high[k])high[k]=v};
  if(mesh)mesh.at.forEach((v,i)=>take(v,i%3));
  else{const c=clouds.cloud||clouds.points;c.quant.forEach((v,i)=>take((v/32767.5-1)*c.range,i%3))}
  return {low:low.map((v,k)=>v>high[k]?-1:v-1e-3),high:high.map((v,k)=>v<low[k]?1:v+1e-3)};
})();
const sliders=[...root.querySelectorAll('.tv-cut input')];
function setCut(){
  for(let k=0;k<3;k++){
    const part=j=>box.low[k]+(box.high[k]-box.low[k])*sliders[2*k+j].value/1000;
    cut.low[k]=cut.on?Math.min(part(0),part(1)):-FAR;cut.high[k]=cut.on?Math.max(part(0),part(1)):FAR;
  }
  need();
}

// Measuring: two clicks on what is seen.
let measuring=false,ends=[];
// The point under a pixel: of the surface where its ray meets it, of clouds the nearest within 8 px.
function pick(x,y){
  const a=axes(),f=focal(),eye=t.map((v,k)=>v+d*a.z[k]);
  const ray=[0,1,2].map(k=>(x-width/2)/f*a.x[k]-(y-height/2)/f*a.y[k]-a.z[k]);
  let best=Infinity,found=null;
  if(mesh&&on.mesh){
    const v=mesh.at,cross=(a,b)=>[a[1]*b[2]-a[2]*b[1],a[2]*b[0]-a[0]*b[2],a[0]*b[1]-a[1]*b[0]];
    for(let i=0;i<mesh.index.length;i+=3){
      const p=3*mesh.index[i],q=3*mesh.index[i+1],r=3*mesh.index[i+2];
      const e=[v[q]-v[p],v[q+1]-v[p+1],v[q+2]-v[p+2]],g=[v[r]-v[p],v[r+1]-v[p+1],v[r+2]-v[p+2]];
      const h=cross(ray,g),det=e[0]*h[0]+e[1]*h[1]+e[2]*h[2];
      if(Math.abs(det)<1e-14)continue;
      const s=[eye[0]-v[p],eye[1]-v[p+1],eye[2]-v[p+2]],u=dot(s,...h)/det;
      if(u<0||u>1)continue;
      const n=cross(s,e),w=dot(ray,...n)/det;
      if(w<0||u+w>1)continue;
      const l=dot(g,...n)/det;
      if(l<=.01*d||l>=best)continue;
      const point=eye.map((o,k)=>o+l*ray[k]);
      if(inCut(point)){best=l;found=point}
    }
    if(found)return found;
  }
  const project=projector(),out=[0,0,0],point=[0,0,0];
  for(const [name,c] of Object.entries(clouds)){
    if(!on[name])continue;
    for(let i=0;i<c.n;i++){
      for(let k=0;k<3;k++)point[k]=(c.quant[3*i+k]/32767.5-1)*c.range;
      project(...point,out);
      // Nearer ones hide others; among them the one closest to the click.
      const off=Math.hypot(out[0]-x,out[1]-y),order=out[2]*(1+.002*off);
      if(out[2]>.01*d&&off<8&&order<best&&inCut(point)){best=order;found=[...point]}
    }
  }
  return found;
}
const written=v=>v===0?'0':Number(v.toPrecision(4)).toString();
function drawOver(){
  const project=projector(),p=[0,0,0],q=[0,0,0];
  let text='';
  const line=(a,b,name)=>{
    project(...a,p);project(...b,q);
    if(p[2]>.01*d&&q[2]>.01*d)text+=`<line class="${name}" x1="${p[0]}" y1="${p[1]}" x2="${q[0]}" y2="${q[1]}"/>`;
  };
  if(cut.on){
    const corner=i=>[0,1,2].map(k=>i>>k&1?cut.high[k]:cut.low[k]);
    for(let i=0;i<8;i++)for(let k=0;k<3;k++)if(!(i>>k&1))line(corner(i),corner(i|1<<k),'tv-box');
  }
  if(ends.length===2)line(...ends,'tv-rule');
  for(const end of ends){project(...end,p);if(p[2]>.01*d)text+=`<circle cx="${p[0]}" cy="${p[1]}" r="4"/>`}
  if(over.innerHTML!==text)over.innerHTML=text;
  const said=$('.tv-length');
  said.hidden=!measuring;
  if(ends.length===2)said.textContent=written(Math.hypot(...ends[0].map((v,k)=>v-ends[1][k]))*data.unit)+' units of the model';
  else said.textContent=ends.length?'click the second point':'click two points';
}
function click(x,y){
  if(!measuring)return;
  const point=pick(x,y);
  if(!point)return;
  if(ends.length===2)ends=[];
  ends.push(point);need();
}

const turn=(dx,dy)=>{yaw-=dx*.0075;pitch=clamp(pitch+dy*.0075,-1.55,1.55)};
const move=(dx,dy)=>{const a=axes(),s=d/focal();t=t.map((v,k)=>v-s*dx*a.x[k]+s*dy*a.y[k])};
const zoom=f=>{d=clamp(d*f,.02,40)};
const down=new Map();
let awake=!inside;
function listen(){
  canvas.classList.toggle('tv-inside',inside);
  const hear=(type,f,options)=>canvas.addEventListener(type,f,options);
  const local=e=>{const b=canvas.getBoundingClientRect();return [e.clientX-b.left,e.clientY-b.top]};
  let still=null;   // where a press began that has not moved
  hear('pointerdown',e=>{awake=true;still=local(e);down.set(e.pointerId,local(e));
    try{canvas.setPointerCapture(e.pointerId)}catch(x){}
    tip.hidden=true});
  hear('pointermove',e=>{
    const p=local(e),q=down.get(e.pointerId);
    if(!q){if(e.pointerType!=='touch')hover(...p);return}
    const dx=p[0]-q[0],dy=p[1]-q[1];
    if(still&&Math.hypot(p[0]-still[0],p[1]-still[1])<4)return;
    still=null;
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
  hear('pointerup',e=>{if(still&&down.size===1&&e.button===0)click(...still);still=null;up(e)});hear('pointercancel',up);hear('lostpointercapture',up);
  hear('pointerleave',()=>{if(!down.size){light(-1);tip.hidden=true;awake=!inside}});
  hear('wheel',e=>{
    // On another page the wheel is that page's, until this view was clicked.
    if(!awake&&!e.ctrlKey)return;
    e.preventDefault();untouched=false;
    zoom(Math.exp(clamp(e.deltaY*(e.deltaMode===1?30:e.deltaMode===2?300:1),-240,240)*.0015));need();
  },{passive:false});
  hear('contextmenu',e=>e.preventDefault());
  hear('dblclick',()=>{if(!measuring)reset()});
  hear('keydown',e=>{
    const step={ArrowLeft:[16,0],ArrowRight:[-16,0],ArrowUp:[0,16],ArrowDown:[0,-16]}[e.key];
    if(step){if(e.shiftKey)move(...step);else turn(...step)}
    else if(e.key==='+'||e.key==='=')zoom(.9);
    else if(e.key==='-')zoom(1/.9);
    else if(e.key==='0'){reset();return}
    else if(e.key==='Escape'&&measuring)ends=[];
    else return;
    untouched=false;e.preventDefault();need();
  });
  hear('webglcontextlost',e=>{e.preventDefault();painter=null});
  hear('webglcontextrestored',()=>start());
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
  if(plainly&&data.drawn>15000&&on.points)$('.tv-drawn').textContent=data.plainly;
  resize();
}

$('.tv-reset').onclick=reset;
const shown=$('.tv-show'),listed=$('.tv-list');
for(const button of root.querySelectorAll('.tv-layer')){
  const name=button.dataset.layer;
  button.setAttribute('aria-pressed',on[name]);
  button.onclick=()=>{on[name]=!on[name];button.setAttribute('aria-pressed',on[name]);need()};
}
$('.tv-measure').onclick=e=>{measuring=!measuring;ends=[];e.target.setAttribute('aria-pressed',measuring);canvas.classList.toggle('tv-cross',measuring);need()};
$('.tv-slice').onclick=e=>{cut.on=!cut.on;$('.tv-cut').hidden=!cut.on;e.target.setAttribute('aria-pressed',cut.on);setCut()};
for(const slider of sliders)slider.oninput=setCut;
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
